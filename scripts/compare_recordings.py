"""Localizes labelled recordings by sound alone, beside SRP-PHAT, MUSIC and NormMUSIC; see --help."""

from avssl_pyro.cli.benchmark_recordings import recordings
from avssl_pyro.cli.command import run

if __name__ == "__main__":
    run(recordings)
