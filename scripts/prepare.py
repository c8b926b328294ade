"""Cuts recordings into clips for training; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.prepare import main

if __name__ == "__main__":
    run(main)
