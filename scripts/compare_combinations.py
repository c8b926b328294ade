"""Puts priors, likelihoods and guides beside each other on the same clips; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.compare_combinations import main

if __name__ == "__main__":
    run(main)
