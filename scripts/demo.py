"""Runs the whole method on simulated scenes; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.demo import main

if __name__ == "__main__":
    run(main)
