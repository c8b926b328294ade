"""Our own localizers, amortized or refined, as methods of the evaluation."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, product

import numpy as np

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.clip import Clip
from avssl_pyro.evaluation.metrics import Azimuths
from avssl_pyro.localization.posterior import ClipPosterior, SourceThresholds, select_sources

LEVELS = (0.01, 0.02, 0.04, 0.06, 0.09, 0.12, 0.16, 0.2, 0.25)
PEAKS = (0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)
# Few microphones spread one talker over more directions.
MERGES_DEG = (12.0, 20.0)
SOURCE_SETTINGS = tuple(
    SourceThresholds(level, peak, merge_deg) for merge_deg, level, peak in product(MERGES_DEG, LEVELS, PEAKS)
)


def _batches(clips: Iterable[Clip], size: int) -> Iterator[list[Clip]]:
    clips = iter(clips)
    while batch := list(islice(clips, size)):
        yield batch


@dataclass(frozen=True)
class PosteriorMethod:
    """A function from clips to posteriors as a :class:`avssl_pyro.evaluation.methods.Method`.

    Args:
        name: how tables call it, e.g. ``amortized``.
        posteriors: posteriors of a batch of clips, in order.
        grid: directions of the posteriors.
        batch_size: most clips handed to ``posteriors`` at a time.
        settings: candidate thresholds.
    """

    name: str
    posteriors: Callable[[Sequence[Clip]], Iterable[ClipPosterior]]
    grid: DirectionGrid
    batch_size: int = 32
    settings: Sequence[SourceThresholds] = field(default=SOURCE_SETTINGS, repr=False)

    def observe_all(self, clips: Iterable[Clip]) -> list[ClipPosterior]:
        # Activation maps are by far the largest part of a posterior and no threshold looks at them.
        return [
            replace(posterior, activations_kij=None)
            for batch in _batches(clips, self.batch_size)
            for posterior in self.posteriors(batch)
        ]

    def decide(self, observation: ClipPosterior, setting: SourceThresholds) -> Azimuths:
        return np.array([source.azimuth for source in select_sources(observation, self.grid, setting)])
