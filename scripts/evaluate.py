"""Scores trained systems and audio-only baselines; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.evaluate import main

if __name__ == "__main__":
    run(main)
