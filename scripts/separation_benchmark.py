"""Prints how well talkers are separated; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.separation_benchmark import main

if __name__ == "__main__":
    run(main)
