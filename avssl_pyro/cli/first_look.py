"""A look at the command line before it is parsed, for an option that decides the defaults of others."""

import argparse
from collections.abc import Sequence


def given(option: str, args: Sequence[str] | None) -> str | None:
    """The text given for an option such as ``--preset``, right or wrong; None if it is not there.

    Args:
        option: with its dashes.
        args: of the command; by default those of the process.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument(option, dest="text")
    text: str | None = parser.parse_known_args(args)[0].text
    return text
