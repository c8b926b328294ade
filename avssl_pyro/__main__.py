"""``python -m avssl_pyro`` is the command ``avssl``."""

from avssl_pyro.cli.app import entry_point

if __name__ == "__main__":
    entry_point()
