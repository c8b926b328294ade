"""Compares methods on labelled recordings by audio alone; see --help."""

from avssl_pyro.cli.benchmark.recordings import recordings
from avssl_pyro.cli.command import run

if __name__ == "__main__":
    run(recordings)
