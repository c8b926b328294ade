"""What a localization method is to the evaluation: an expensive look at each clip, then a cheap, tunable decision."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy.typing as npt

from avssl_pyro.data.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.metrics import Azimuths, evaluate

ObservationT = TypeVar("ObservationT")
SettingT = TypeVar("SettingT")


class Method(Protocol[ObservationT, SettingT]):
    """A localization method: it sees clips and never their labels."""

    @property
    def name(self) -> str:
        """How tables and reports call it."""
        ...

    @property
    def settings(self) -> Sequence[SettingT]:
        """Candidate decision thresholds, at least one."""
        ...

    def observe_all(self, clips: Iterable[Clip]) -> list[ObservationT]:
        """The expensive part, done once per clip whatever the number of settings."""
        ...

    def decide(self, observation: ObservationT, setting: SettingT) -> Azimuths:
        """Azimuths of the sources, radians, any number."""
        ...


@dataclass(frozen=True)
class Tuned(Generic[SettingT]):
    """The setting that tuning chose and what it scored on the scenes it was chosen on."""

    setting: SettingT
    f_measure: float
    count_accuracy: float


def tune(
    method: Method[ObservationT, SettingT],
    observations: Sequence[ObservationT],
    references: Sequence[npt.ArrayLike],
    tolerance: float,
) -> Tuned[SettingT]:
    """Picks the setting with the highest mean of F-measure and count accuracy, the two measures of the tables.

    Of equals, the one with the higher F-measure, then the first.

    Args:
        method: the method to tune.
        observations: what it observed on the validation clips.
        references: true azimuths of the same clips, radians.
        tolerance: radians.

    Raises:
        InputError: the method has no settings, or as in :func:`avssl_pyro.evaluation.metrics.evaluate`.
    """

    def merit(tuned: Tuned[SettingT]) -> tuple[float, float]:
        return (tuned.f_measure + tuned.count_accuracy) / 2, tuned.f_measure

    best: Tuned[SettingT] | None = None
    for setting in method.settings:
        scores = evaluate(references, [method.decide(observation, setting) for observation in observations], tolerance)
        tuned = Tuned(setting, scores.f_measure, scores.count_accuracy)
        if best is None or merit(tuned) > merit(best):
            best = tuned
    if best is None:
        raise InputError(f"method '{method.name}' has no settings to choose from; give it at least one.")
    return best
