"""Improvement of SI-SDR over one microphone when talkers are separated from simulated mixtures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.benchmarks.separation_methods import (
    BASELINE,
    OURS,
    Estimates,
    SeparationMethod,
    TalkerMixture,
    default_methods,
    draw_mixture,
)
from avssl_pyro.evaluation.metrics import Interval, bootstrap_mean
from avssl_pyro.evaluation.separation_metrics import si_sdr
from avssl_pyro.evaluation.tables import Column, Table
from avssl_pyro.simulation.panoramas import PanoramaSource
from avssl_pyro.simulation.people import PersonSource
from avssl_pyro.simulation.scene_config import SOME_SILENT, Condition, SceneConfig
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.simulation.speech import SpeechSource
from avssl_pyro.systems.system import System

# Improvements by the name of the method, for every mixture.
Trials = Sequence[Mapping[str, "Improvements"]]
UNPROCESSED = "one microphone"


@dataclass(frozen=True)
class Improvements:
    """Improvements of the talkers of one mixture by one method, dB; 0 for those who were missed.

    Args:
        image_s: improvement of SI-SDR against the talker's image at the reference microphone, with reverberation, (S,).
        direct_s: improvement against the talker's direct sound there, (S,).
        missed: number of talkers without an estimate.
    """

    image_s: npt.NDArray[np.float64]
    direct_s: npt.NDArray[np.float64]
    missed: int


@dataclass(frozen=True)
class SeparationExperiment:
    """Mixtures of a simulator, separated by several methods.

    Args:
        simulator: simulator of the scenes.
        methods: methods of separation.
        reference: number of the microphone at which they estimate, from 0.
    """

    simulator: SceneSimulator
    methods: Sequence[SeparationMethod]
    reference: int = 0

    def run(self, index: int) -> dict[str, Improvements]:
        """Improvements of mixture ``index`` by method; the first entry is the SI-SDR of one microphone."""
        mixture = draw_mixture(self.simulator, index)
        rows = {UNPROCESSED: self._levels(mixture)}
        for method in self.methods:
            for name, estimates in method(mixture).items():
                rows[name] = self._improvements(mixture, estimates)
        return rows

    def _levels(self, mixture: TalkerMixture) -> Improvements:
        mixture_n = mixture.clip.audio_mn[self.reference]
        image_s, direct_s = (
            np.array([si_sdr(mixture_n, reference_mn[self.reference]) for reference_mn in references_smn])
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


@dataclass(frozen=True)
class MethodImprovements:
    """Improvements of one method over all mixtures.

    Args:
        name: name of the method.
        trials: one entry for each mixture.
    """

    name: str
    trials: Sequence[Improvements]

    @property
    def image(self) -> npt.NDArray[np.float64]:
        """Improvements against the images of all talkers, dB."""
        return np.concatenate([one.image_s for one in self.trials])

    @property
    def direct(self) -> npt.NDArray[np.float64]:
        """Improvements against the direct sound of all talkers, dB."""
        return np.concatenate([one.direct_s for one in self.trials])

    @property
    def image_b(self) -> npt.NDArray[np.float64]:
        """Means of every mixture, dB: talkers of one mixture are not independent, so intervals are over mixtures."""
        return np.array([one.image_s.mean() for one in self.trials])

    @property
    def direct_b(self) -> npt.NDArray[np.float64]:
        """Means of every mixture against direct sound, dB."""
        return np.array([one.direct_s.mean() for one in self.trials])

    @property
    def missed(self) -> float:
        """Share of talkers without an estimate."""
        return sum(one.missed for one in self.trials) / len(self.image)


COLUMNS: tuple[Column[MethodImprovements], ...] = (
    Column("separated by", lambda row: row.name),
    Column("image", lambda row: float(row.image.mean()), "{:.2f}"),
    Column("95 %", lambda row: _bounds(bootstrap_mean(row.image_b))),
    Column("median", lambda row: float(np.median(row.image)), "{:.2f}"),
    Column("direct", lambda row: float(row.direct.mean()), "{:.2f}"),
    Column("95 %", lambda row: _bounds(bootstrap_mean(row.direct_b))),
    Column("missed", lambda row: row.missed, "{:.1%}"),
)


def separation_table(trials: Trials, title: str, ours: str, baseline: str) -> Table[MethodImprovements]:
    """Mean improvements with intervals, and shares of missed talkers, one line for each method.

    Args:
        trials: at least one mixture.
        title: title of the table.
        ours, baseline: names of the methods whose difference is noted below.
    """
    rows = [_over_trials(trials, name) for name in trials[0] if name != UNPROCESSED]
    before = _over_trials(trials, UNPROCESSED)
    (image_lead, image_interval), (direct_lead, direct_interval) = lead(trials, ours, baseline)
    notes = (
        f"{UNPROCESSED}: SI-SDR {before.image.mean():.1f} dB against the image, {before.direct.mean():.1f} dB against "
        "direct sound.",
        f"{ours} above {baseline}: {image_lead:.1f} dB ({_bounds(image_interval)}) against the image, "
        f"{direct_lead:.1f} dB ({_bounds(direct_interval)}) against direct sound.",
    )
    return Table(rows, COLUMNS, title, notes)


def lead(trials: Trials, name: str, over: str) -> tuple[tuple[float, Interval], tuple[float, Interval]]:
    """Mean lead of one method over another on the same mixtures, dB, with intervals: image first, then direct sound."""
    ours, theirs = _over_trials(trials, name), _over_trials(trials, over)
    image, direct = ours.image_b - theirs.image_b, ours.direct_b - theirs.direct_b
    return (float(image.mean()), bootstrap_mean(image)), (float(direct.mean()), bootstrap_mean(direct))


def _over_trials(trials: Trials, name: str) -> MethodImprovements:
    return MethodImprovements(name, [trial[name] for trial in trials])


def _bounds(interval: Interval) -> str:
    return f"{interval.low:.1f} to {interval.high:.1f}"


def run_separation(
    system: System,
    array: MicrophoneArray,
    material: tuple[SpeechSource, PersonSource, PanoramaSource],
    num_scenes: int,
    seed: int,
    name: str,
) -> Table[MethodImprovements]:
    """Table of the default methods on mixtures of two talkers, among up to two silent people.

    Args:
        system: trained system.
        array: microphones of the mixtures.
        material: speech, people and rooms.
        num_scenes: number of mixtures.
        seed: seed of the scenes.
        name: name of the array in the title.
    """
    speech, people, panoramas = material
    simulator = SceneSimulator(
        config=SceneConfig(condition=Condition(SOME_SILENT.name, SOME_SILENT.people, talkers=(2,))),
        seed=seed,
        speech=speech,
        people=people,
        panoramas=panoramas,
        array=array,
    )
    experiment = SeparationExperiment(simulator, default_methods(system, array))
    trials = [experiment.run(index) for index in tqdm(range(num_scenes), unit="scene", desc="separating")]
    title = f"{name}: SI-SDR improvement in dB, {num_scenes} mixtures of two talkers, seed {seed}"
    return separation_table(trials, title, OURS, BASELINE)
