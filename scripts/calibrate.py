"""Tests posteriors by simulation-based calibration; see --help."""

from avssl_pyro.cli.calibrate import main
from avssl_pyro.cli.command import run

if __name__ == "__main__":
    run(main)
