"""Scores separated sources by SI-SDR; see --help."""

from avssl_pyro.cli.benchmark.recordings import separation
from avssl_pyro.cli.command import run

if __name__ == "__main__":
    run(separation)
