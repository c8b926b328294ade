"""Checks a recording against its array and its camera; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.doctor import main

if __name__ == "__main__":
    run(main)
