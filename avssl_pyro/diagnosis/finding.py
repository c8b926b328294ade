"""Findings of the checks, with severity and confidence."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from avssl_pyro.errors import InputError


class Severity(IntEnum):
    """Severity of a finding; from ``WARNING`` on, act before training."""

    OK = 0
    NOTE = 1
    WARNING = 2
    ERROR = 3

    @property
    def word(self) -> str:
        return self.name.lower()


@dataclass(frozen=True)
class Finding:
    """One line of a diagnosis.

    Args:
        check: name of the check.
        severity: severity of the finding.
        message: finding in one sentence on one line; channels count from 1.
        confidence: confidence in [0, 1].
        advice: advised action; empty where none is needed.

    Raises:
        InputError: the message has several lines or the confidence is no probability.
    """

    check: str
    severity: Severity
    message: str
    confidence: float
    advice: str = ""

    def __post_init__(self) -> None:
        if "\n" in self.message + self.advice:
            raise InputError(f"finding of '{self.check}': a finding is one line.")
        if not 0.0 <= self.confidence <= 1.0:
            raise InputError(f"finding of '{self.check}': a confidence of {self.confidence} is not in [0, 1].")

    def to_dict(self) -> dict[str, Any]:
        """The finding as JSON values."""
        return {
            "check": self.check,
            "severity": self.severity.word,
            "message": self.message,
            "confidence": round(self.confidence, 3),
            "advice": self.advice,
        }


def listed(names: list[str]) -> str:
    """``1``, ``1 and 2``, ``1, 2 and 3``."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def channels(numbers: list[int]) -> str:
    """``channel 3`` or ``channels 1 and 2`` for channels counted from 0."""
    return f"channel{'s' if len(numbers) > 1 else ''} {listed([str(number + 1) for number in numbers])}"
