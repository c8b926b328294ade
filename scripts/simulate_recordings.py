"""Renders labelled 360-degree recordings; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.simulate_recordings import main

if __name__ == "__main__":
    run(main)
