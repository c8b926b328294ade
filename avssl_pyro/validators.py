"""Validators of attrs fields: bad values raise one sentence with class, field, value, and what would be right."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class Requirement:
    """A condition on a value; as an attrs validator it raises InputError, and NaN never fulfils it.

    Args:
        fulfilled: function from a value to whether the condition holds.
        right: words for the values that fulfil it, after "it must be".
    """

    fulfilled: Callable[[Any], bool]
    right: str

    def __call__(self, instance: object, attribute: Any, value: Any) -> None:
        self.check_value(type(instance).__name__, attribute.name, value)

    def check(self, instance: object, *names: str) -> None:
        """Raises InputError unless the named attributes fulfil it; for classes that have to be dataclasses."""
        for name in names:
            self.check_value(type(instance).__name__, name, getattr(instance, name))

    def check_value(self, owner: str, name: str, value: Any) -> None:
        """Raises InputError unless ``value``, called ``name`` in ``owner``, fulfils it."""
        if not self.fulfilled(value):
            raise InputError(f"{owner}: {name} is {value}; it must be {self.right}.")


positive = Requirement(lambda value: 0 < value < math.inf, "positive")
"""Finite and above 0."""


def at_least(least: float) -> Requirement:
    """Finite and not below ``least``."""
    return Requirement(lambda value: least <= value < math.inf, f"at least {least:g}")


def between(low: float, high: float) -> Requirement:
    """Above ``low`` and below ``high``."""
    return Requirement(lambda value: low < value < high, f"between {low:g} and {high:g}")


def within(low: float, high: float) -> Requirement:
    """From ``low`` to ``high``, both included."""
    return Requirement(lambda value: low <= value <= high, f"from {low:g} to {high:g}")
