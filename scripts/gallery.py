"""Draws overlays of scenes chosen by a rule; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.gallery import main

if __name__ == "__main__":
    run(main)
