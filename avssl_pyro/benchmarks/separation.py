"""How much cleaner talkers come out of simulated mixtures: the improvement of SI-SDR over one microphone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.benchmarks.separation_methods import Estimates, SeparationMethod
from avssl_pyro.benchmarks.talker_mixtures import TalkerMixture, draw_mixture
from avssl_pyro.evaluation.si_sdr import si_sdr
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
