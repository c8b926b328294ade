"""Splits of clips into training and validation without overlap in time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from avssl_pyro.errors import InputError
from avssl_pyro.recordings.candidates import ClipCandidate
from avssl_pyro.recordings.recording import Recording
from avssl_pyro.validators import between

Parts = dict[str, tuple[ClipCandidate, ...]]


class Splitter(Protocol):
    """Split of clips into named parts, one folder each.

    The part named "" is the folder of the data set.
    """

    def split(self, places: Sequence[ClipCandidate], recordings: Sequence[Recording], duration_s: float) -> Parts: ...


@dataclass(frozen=True)
class NoSplit:
    """Split with all clips in one part."""

    def split(self, places: Sequence[ClipCandidate], recordings: Sequence[Recording], duration_s: float) -> Parts:  # noqa: ARG002
        return {"": tuple(places)}


@dataclass(frozen=True)
class ByRecording:
    """Split by recording: whole recordings, drawn at random, are for validation.

    Args:
        share: approximate share of the recordings for validation; at least one is drawn.
        seed: seed of the draw.
    """

    share: float = 0.1
    seed: int = 0

    def __post_init__(self) -> None:
        between(0, 1).check(self, "share")

    def split(self, places: Sequence[ClipCandidate], recordings: Sequence[Recording], duration_s: float) -> Parts:  # noqa: ARG002
        """Returns the parts ``train`` and ``validation``.

        Raises:
            InputError: fewer than two recordings hold clips.
        """
        numbers = sorted({place.recording for place in places})
        if len(numbers) < 2:
            raise InputError(
                "only one recording holds clips, so none can be kept aside for validation; split by time instead."
            )
        count = min(len(numbers) - 1, max(1, round(self.share * len(numbers))))
        kept = set(np.random.default_rng(self.seed).permutation(numbers)[:count].tolist())
        return {
            "train": tuple(place for place in places if place.recording not in kept),
            "validation": tuple(place for place in places if place.recording in kept),
        }


@dataclass(frozen=True)
class ByTime:
    """Split by time: the end of every recording is for validation.

    Clips across the border are in neither part.

    Args:
        share: share of each recording's duration for validation.
    """

    share: float = 0.1

    def __post_init__(self) -> None:
        between(0, 1).check(self, "share")

    def split(self, places: Sequence[ClipCandidate], recordings: Sequence[Recording], duration_s: float) -> Parts:
        """Returns the parts ``train`` and ``validation``.

        Raises:
            InputError: a part is empty.
        """
        borders_s = [recording.end_s - self.share * recording.duration_s for recording in recordings]
        parts = {
            "train": tuple(
                place for place in places if place.start_s + duration_s <= borders_s[place.recording] + 1e-6
            ),
            "validation": tuple(place for place in places if place.start_s >= borders_s[place.recording] - 1e-6),
        }
        for name, part in parts.items():
            if not part:
                raise InputError(
                    f"no clip is left for the part '{name}'; take more clips or another share than {self.share:g}."
                )
        return parts
