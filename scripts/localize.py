"""Estimates the sources of clips and recordings; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.localize import main

if __name__ == "__main__":
    run(main)
