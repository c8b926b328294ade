"""Tests posteriors by simulation-based calibration; see --help."""

from avssl_pyro.cli.benchmark.systems import calibration
from avssl_pyro.cli.command import run

if __name__ == "__main__":
    run(calibration)
