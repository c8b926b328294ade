"""Multi-target filter with soft assignment of detections to one chain per source."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.models.tracking.detection import DetectionModel
from avssl_pyro.models.tracking.motion import TrackPrior, TrackTables
from avssl_pyro.tracking.hmm_filter import Array, Step, TrackState, initial, observe, predict

# Least probability that a source exists; below it, its chain ends.
LEAST_PRESENCE = 1e-3
HEARD = 0.5
# Number of step lengths, in whole milliseconds, whose transition tables are cached; recordings rarely have more.
NUM_STEP_LENGTHS = 16


@dataclass(eq=False)
class Chain:
    """Filtered windows of a candidate source, which may be clutter.

    Args:
        first: index of its first window.
        steps: filtered windows from ``first`` on.
        shares_tnd: probabilities per window that detection n belongs to this source in direction d, (N, D).
        born_s: time of its first window in seconds.
        detected_s: time of its last detection in seconds.
        beside: index and time in seconds of the window since which an older chain is close, or None.
    """

    first: int
    steps: list[Step]
    shares_tnd: list[npt.NDArray[np.float32]]
    born_s: float
    detected_s: float
    beside: tuple[int, float] | None = None

    @property
    def belief(self) -> TrackState:
        return self.steps[-1].filtered

    def cut(self, before: int) -> None:
        """Removes the windows from index ``before`` on."""
        kept = max(before - self.first, 0)
        del self.steps[kept:], self.shares_tnd[kept:]

    def trim(self, to: int) -> None:
        """Removes the windows before index ``to``."""
        gone = min(max(to - self.first, 0), len(self.steps) - 1)
        del self.steps[:gone], self.shares_tnd[:gone]
        self.first += gone


@dataclass(frozen=True)
class MultiTargetConfig:
    """Settings of the end and merging of sources.

    Args:
        memory_s: longest time in seconds without a detection; a later detection starts a new source.
        merge_deg: distance in degrees below which two sources are close.
        merge_s: time in seconds after which close sources are merged, longer than talkers take to pass each other. A
            source that comes close within this time of its birth is merged at once.
    """

    memory_s: float = 2.5
    merge_deg: float = 8.0
    merge_s: float = 2.0


class MultiTargetFilter:
    """Forward algorithm for all chains, window by window.

    A chain counts the claims of other chains on a detection as clutter. A detection that is more probably clutter than
    part of a chain starts a new chain. Ended chains are stored in ``ended``.

    Args:
        grid: directions of the tracks.
        prior: prior of motion, pauses, births and deaths.
        detection: model of detections and clutter.
        config: settings of the end and merging of sources.
    """

    def __init__(
        self, grid: DirectionGrid, prior: TrackPrior, detection: DetectionModel, config: MultiTargetConfig
    ) -> None:
        self.grid, self.detection, self.config = grid, detection, config
        self.active: list[Chain] = []
        self.ended: list[Chain] = []
        self.num_windows = 0
        self._tables_of = lru_cache(maxsize=NUM_STEP_LENGTHS)(lambda step_ms: prior.tables(grid, step_ms / 1000))

    def add(self, time_s: float, step_s: float, azimuth_n: Array, std_n: Array) -> None:
        """Adds the detections of the next window.

        Args:
            time_s: time of the window in seconds.
            step_s: time since the window before in seconds.
            azimuth_n, std_n: azimuths and their standard deviations in radians, each (N,).
        """
        tables = self._tables_of(max(round(step_s * 1000), 1))
        density_nd = self.detection.density(self.grid, azimuth_n, std_n)
        predicted_k = [predict(chain.belief, tables) for chain in self.active]
        claims_kn = np.zeros((len(self.active), len(azimuth_n)))
        for k, predicted in enumerate(predicted_k):
            sounding_d = predicted.sounding_d
            expected_n = self.detection.found * (density_nd @ sounding_d)
            claims_kn[k] = self.detection.claims(expected_n, float(sounding_d.sum()))
        for k, (chain, predicted) in enumerate(zip(self.active, predicted_k, strict=True)):
            terms_nd = self.detection.ratio_terms(density_nd, np.delete(claims_kn, k, axis=0).sum(0))
            self._extend(chain, predicted, terms_nd, tables, time_s)
        claimed_n = claims_kn.sum(0)
        for n in np.flatnonzero(claimed_n < self.detection.clutter_density):
            terms_nd = self.detection.ratio_terms(density_nd, claimed_n)
            terms_nd[np.arange(len(terms_nd)) != n] = 0.0
            chain = Chain(self.num_windows, [], [], time_s, time_s)
            self._extend(chain, initial(tables.birth, self.grid.num_directions), terms_nd, tables, time_s)
            self.active.append(chain)
        self._merge(time_s)
        self._retire(time_s)
        self.num_windows += 1

    def finish(self) -> None:
        """Ends all chains."""
        self.ended += self.active
        self.active = []

    def _extend(self, chain: Chain, predicted: TrackState, terms_nd: Array, tables: TrackTables, time_s: float) -> None:
        ratio_d = self.detection.missed + terms_nd.sum(0)
        chain.steps.append(observe(predicted, ratio_d, tables))
        share_nd = terms_nd / ratio_d
        chain.shares_tnd.append(share_nd.astype(np.float32))
        if (share_nd @ chain.belief.sounding_d).sum() > HEARD:
            chain.detected_s = time_s

    def _merge(self, time_s: float) -> None:
        azimuths_k = np.array([chain.belief.direction(self.grid)[0] for chain in self.active])
        sounding_k = np.array([chain.belief.sounding_d.sum() for chain in self.active])
        for k, chain in enumerate(list(self.active)):
            apart_j = np.abs(wrap_angle(azimuths_k[:k] - azimuths_k[k]))
            # An older source in a pause must not absorb a talker close to it.
            if not ((apart_j < np.deg2rad(self.config.merge_deg)) & (sounding_k[:k] > sounding_k[k] / 2)).any():
                chain.beside = None
                continue
            index, since_s = chain.beside = chain.beside or (self.num_windows, time_s)
            if time_s - since_s > self.config.merge_s or since_s - chain.born_s < self.config.merge_s:
                self.active.remove(chain)
                chain.cut(index)
                self.ended += [chain] if chain.steps else []

    def _retire(self, time_s: float) -> None:
        for chain in list(self.active):
            if chain.belief.presence < LEAST_PRESENCE or time_s - chain.detected_s > self.config.memory_s:
                self.active.remove(chain)
                self.ended.append(chain)
