"""Compares Pyro's ELBO with its closed forms; see --help."""

from avssl_pyro.cli.benchmark.systems import elbo
from avssl_pyro.cli.command import run

if __name__ == "__main__":
    run(elbo)
