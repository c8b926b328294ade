"""Measures speed and memory; see --help."""

from avssl_pyro.cli.benchmark.systems import speed
from avssl_pyro.cli.command import run

if __name__ == "__main__":
    run(speed)
