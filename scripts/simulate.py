"""Renders labelled audio-visual scenes; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.simulate import main

if __name__ == "__main__":
    run(main)
