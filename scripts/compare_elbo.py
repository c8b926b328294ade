"""Prints Pyro's ELBO beside the closed forms; see --help."""

from avssl_pyro.cli.command import run
from avssl_pyro.cli.compare_elbo import main

if __name__ == "__main__":
    run(main)
