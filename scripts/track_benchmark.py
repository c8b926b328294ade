"""Prints what tracking adds to single windows; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.track_benchmark import main

if __name__ == "__main__":
    run(main)
