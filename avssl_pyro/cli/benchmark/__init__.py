"""Commands of ``avssl benchmark``: each parses its options, calls an experiment, and prints its tables."""

__all__ = [
    "recordings",
    "rooms",
    "systems",
    "tracking",
]
