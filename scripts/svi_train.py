"""Trains the networks by stochastic variational inference; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.train import main

if __name__ == "__main__":
    run(main)
