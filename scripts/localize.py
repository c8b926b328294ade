"""Localizes the sounding objects of clips; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.localize import main

if __name__ == "__main__":
    run(main)
