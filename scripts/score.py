"""Scores directions over a recording against its labels; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.score import main

if __name__ == "__main__":
    run(main)
