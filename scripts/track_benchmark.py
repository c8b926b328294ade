"""Compares tracks with single windows; see --help."""

from avssl_pyro.cli.benchmark.tracking import tracking
from avssl_pyro.cli.command import run

if __name__ == "__main__":
    run(tracking)
