"""How much cleaner talkers come out of simulated mixtures: the improvement of SI-SDR over one microphone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.evaluation.metrics import Interval, bootstrap_mean
from avssl_pyro.evaluation.separation_methods import Estimates, SeparationMethod
from avssl_pyro.evaluation.si_sdr import si_sdr
from avssl_pyro.evaluation.talker_mixtures import TalkerMixture, draw_mixture
from avssl_pyro.simulation.scenes import SceneSimulator

UNPROCESSED = "one microphone"


@dataclass(frozen=True)
class Improvements:
    """What one way of separation did to the talkers of one mixture, dB; 0 for those who were missed.

    Args:
        image_s: of SI-SDR against the talker's image at the reference microphone, reverberation and all, (S,).
        direct_s: against the talker's direct sound there, (S,).
        missed: talkers without an estimate.
    """

    image_s: npt.NDArray[np.float64]
    direct_s: npt.NDArray[np.float64]
    missed: int


@dataclass(frozen=True)
class SeparationSummary:
    """One row of the table, dB.

    Args:
        image_mean, image_interval, image_median: improvement against the image; intervals are over mixtures.
        direct_mean, direct_interval, direct_median: against the direct sound.
        missed: share of the talkers.
    """

    image_mean: float
    image_interval: Interval
    image_median: float
    direct_mean: float
    direct_interval: Interval
    direct_median: float
    missed: float


@dataclass(frozen=True)
class SeparationExperiment:
    """Mixtures of a simulator, separated by several methods.

    Args:
        simulator: of the scenes.
        methods: each with one or more ways.
        reference: microphone at which they estimate, counted from 0.
    """

    simulator: SceneSimulator
    methods: Sequence[SeparationMethod]
    reference: int = 0

    def run(self, index: int) -> dict[str, Improvements]:
        """Mixture ``index``, by the names of the ways; the first row is the SI-SDR itself of one microphone."""
        mixture = draw_mixture(self.simulator, index)
        rows = {UNPROCESSED: self._levels(mixture)}
        for method in self.methods:
            for name, estimates in method(mixture).items():
                rows[name] = self._improvements(mixture, estimates)
        return rows

    def _levels(self, mixture: TalkerMixture) -> Improvements:
        heard_n = mixture.clip.audio_mn[self.reference]
        image_s, direct_s = (
            np.array([si_sdr(heard_n, reference_mn[self.reference]) for reference_mn in references_smn])
            for references_smn in (mixture.images_smn, mixture.direct_smn)
        )
        return Improvements(image_s, direct_s, missed=0)

    def _improvements(self, mixture: TalkerMixture, estimates: Estimates) -> Improvements:
        before = self._levels(mixture)
        image_s, direct_s = np.zeros(len(estimates)), np.zeros(len(estimates))
        for s, estimate_n in enumerate(estimates):
            if estimate_n is not None:
                image_s[s] = si_sdr(estimate_n, mixture.images_smn[s, self.reference]) - before.image_s[s]
                direct_s[s] = si_sdr(estimate_n, mixture.direct_smn[s, self.reference]) - before.direct_s[s]
        return Improvements(image_s, direct_s, missed=sum(estimate_n is None for estimate_n in estimates))


def summarize_separation(trials: Sequence[Mapping[str, Improvements]]) -> dict[str, SeparationSummary]:
    """Every way over all mixtures. Talkers of one mixture are not independent, so intervals are over mixtures."""
    rows = {}
    for name in trials[0]:
        found = [trial[name] for trial in trials]
        image, direct = np.concatenate([one.image_s for one in found]), np.concatenate([one.direct_s for one in found])
        rows[name] = SeparationSummary(
            image_mean=float(image.mean()),
            image_interval=bootstrap_mean(np.array([one.image_s.mean() for one in found])),
            image_median=float(np.median(image)),
            direct_mean=float(direct.mean()),
            direct_interval=bootstrap_mean(np.array([one.direct_s.mean() for one in found])),
            direct_median=float(np.median(direct)),
            missed=sum(one.missed for one in found) / len(image),
        )
    return rows


def lead(trials: Sequence[Mapping[str, Improvements]], name: str, over: str) -> tuple[float, Interval]:
    """Mean lead of one way over another on the same mixtures against the image, dB, and its interval."""
    lead_b = np.array([float(trial[name].image_s.mean() - trial[over].image_s.mean()) for trial in trials])
    return float(lead_b.mean()), bootstrap_mean(lead_b)
