"""Compares methods on clips from measured room responses; see --help."""

from avssl_pyro.cli.benchmark.rooms import rooms
from avssl_pyro.cli.command import run

if __name__ == "__main__":
    run(rooms)
