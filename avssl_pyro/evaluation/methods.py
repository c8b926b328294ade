"""What a localization method is to the evaluation: an expensive look at each clip, then a cheap, tunable decision."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy.typing as npt

from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.metrics import Azimuths, evaluate

# Half a point of F-measure is noise on some hundred scenes.
AS_GOOD_F = 0.005
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
    """Picks a setting by F-measure, and by count accuracy among those whose F-measure is as good as the best.

    Count accuracy alone would reward a method that always says two.

    Args:
        method: the method to tune.
        observations: what it observed on the validation clips.
        references: true azimuths of the same clips, radians.
        tolerance: radians.

    Raises:
        InputError: the method has no settings, or as in :func:`avssl_pyro.evaluation.metrics.evaluate`.
    """
    candidates: list[Tuned[SettingT]] = []
    for setting in method.settings:
        scores = evaluate(references, [method.decide(observation, setting) for observation in observations], tolerance)
        candidates.append(Tuned(setting, scores.f_measure, scores.count_accuracy))
    if not candidates:
        raise InputError(f"method '{method.name}' has no settings to choose from; give it at least one.")
    least_f = max(tuned.f_measure for tuned in candidates) - AS_GOOD_F
    good = [tuned for tuned in candidates if tuned.f_measure >= least_f]
    return max(good, key=lambda tuned: (tuned.count_accuracy, tuned.f_measure))


def plain_and_tuned(
    method: Method[ObservationT, SettingT],
    observations: Sequence[ObservationT],
    references: Sequence[Azimuths],
    setting: SettingT,
    tolerance: float,
) -> dict[str, list[Azimuths]]:
    """Two rows of a comparison without validation data, by name: decided by a fixed setting, and by the best one.

    Args:
        method, observations, references, tolerance: as of :func:`tune`; the best setting is that for these very labels.
        setting: the fixed one.
    """
    best = tune(method, observations, references, tolerance).setting
    return {
        name: [method.decide(observation, chosen) for observation in observations]
        for name, chosen in ((method.name, setting), (f"{method.name}, tuned", best))
    }
