"""Compares combinations of priors, likelihoods and guides; see --help."""

from avssl_pyro.cli.benchmark.systems import combinations
from avssl_pyro.cli.command import run

if __name__ == "__main__":
    run(combinations)
