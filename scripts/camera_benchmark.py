"""Measures the estimates of yaw and mirroring of simulated cameras; see --help."""

from avssl_pyro.cli.benchmark.recordings import camera
from avssl_pyro.cli.command import run

if __name__ == "__main__":
    run(camera)
