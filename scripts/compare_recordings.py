"""Localizes labelled recordings by sound alone, beside SRP-PHAT, MUSIC and NormMUSIC; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.compare_recordings import main

if __name__ == "__main__":
    run(main)
