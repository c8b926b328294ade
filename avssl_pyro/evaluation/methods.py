"""Localization methods: an expensive observation, then a cheap decision with tunable settings."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.metrics import Azimuths, evaluate
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.localization.posterior import ClipPosterior

# Half a point of F-measure is noise on some hundred scenes.
AS_GOOD_F = 0.005
LEVELS = (
    0.001,
    0.002,
    0.003,
    0.004,
    0.005,
    0.006,
    0.007,
    0.008,
    0.01,
    0.013,
    0.016,
    0.02,
    0.03,
    0.035,
    0.04,
    0.06,
    0.1,
)
SOURCE_SETTINGS = tuple(DirectLevelRule(level) for level in LEVELS)
ObservationT = TypeVar("ObservationT")
SettingT = TypeVar("SettingT")


class Method(Protocol[ObservationT, SettingT]):
    """A localization method: it gets clips and never their labels."""

    @property
    def name(self) -> str:
        """Name in tables and reports."""
        ...

    @property
    def settings(self) -> Sequence[SettingT]:
        """Candidate decision thresholds, at least one."""
        ...

    def observe_all(self, clips: Iterable[Clip]) -> list[ObservationT]:
        """Observations of the clips: the expensive part, done once whatever the number of settings."""
        ...

    def decide(self, observation: ObservationT, setting: SettingT) -> Azimuths:
        """Azimuths of the sources, radians, any number."""
        ...


@dataclass(frozen=True)
class Tuned(Generic[SettingT]):
    """The chosen setting, and its scores on the scenes on which it was chosen."""

    setting: SettingT
    f_measure: float
    count_accuracy: float


def tune(
    method: Method[ObservationT, SettingT],
    observations: Sequence[ObservationT],
    references: Sequence[npt.ArrayLike],
    tolerance: float,
) -> Tuned[SettingT]:
    """Chooses a setting by F-measure, then by count accuracy among the equally good.

    Count accuracy alone would reward a method that always finds two sources.

    Args:
        method: method to tune.
        observations: its observations of the validation clips.
        references: true azimuths of the same clips, radians.
        tolerance: largest error that counts as correct, radians.

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
    """Azimuths by a fixed setting and by the best one, by name, for comparisons without validation data.

    Args:
        method, observations, references, tolerance: as of :func:`tune`; the best setting is chosen on these labels.
        setting: fixed setting.
    """
    best = tune(method, observations, references, tolerance).setting
    return {
        name: [method.decide(observation, chosen) for observation in observations]
        for name, chosen in ((method.name, setting), (f"{method.name}, tuned", best))
    }


@dataclass(frozen=True)
class PosteriorMethod:
    """A localizer as a :class:`Method`.

    Args:
        name: name in tables, e.g. ``amortized``.
        posteriors: function from a batch of clips to their posteriors, in order.
        grid: directions of the posteriors.
        batch_size: largest number of clips in a batch.
        settings: candidate rules.
    """

    name: str
    posteriors: Callable[[Sequence[Clip]], Iterable[ClipPosterior]]
    grid: DirectionGrid
    batch_size: int = 32
    settings: Sequence[DirectLevelRule] = field(default=SOURCE_SETTINGS, repr=False)

    def observe_all(self, clips: Iterable[Clip]) -> list[ClipPosterior]:
        # Activation maps are by far the largest part of a posterior, and no rule depends on them.
        return [
            replace(posterior, activations_kij=None)
            for batch in _batches(clips, self.batch_size)
            for posterior in self.posteriors(batch)
        ]

    def decide(self, observation: ClipPosterior, setting: DirectLevelRule) -> Azimuths:
        return np.array([source.azimuth for source in setting.select(observation, self.grid)])


def _batches(clips: Iterable[Clip], size: int) -> Iterator[list[Clip]]:
    clips = iter(clips)
    while batch := list(islice(clips, size)):
        yield batch
