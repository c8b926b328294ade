"""Separation of talkers from a simulated mixture: by the truth, for comparison, and by a posterior."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt
import torch

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.stft import istft, stft
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.clip import Clip
from avssl_pyro.evaluation.matching import angular_errors, gate_then_assign
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.separation.beamforming import Extraction, Masking, Mvdr, delay_and_sum
from avssl_pyro.separation.separator import SeparationConfig, Separator
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.systems.system import System

OURS = "refined: Wiener"
BASELINE = "delay and sum at the truth"


@dataclass(frozen=True)
class TalkerMixture:
    """A simulated clip, and the sound of each of its talkers.

    Args:
        clip: mixture and image.
        azimuths: of the talkers, (S,), radians.
        unit_vectors_sx: directions of their mouths, (S, 3).
        images_smn: sound of each talker alone in the room, (S, M, N); in scale with each other, not with the clip.
        direct_smn: direct sound of each, without any reflection.
    """

    clip: Clip
    azimuths: tuple[float, ...]
    unit_vectors_sx: npt.NDArray[np.float64]
    images_smn: npt.NDArray[np.float32]
    direct_smn: npt.NDArray[np.float32]

    def images_and_noise(self) -> npt.NDArray[np.float64]:
        """The parts of the clip, (S + 1, M, N): the talkers' images at their level in it, and all that is left."""
        images_smn = self.images_smn.astype(np.float64)
        sum_mn = images_smn.sum(axis=0)
        # The noise is independent of the talkers, so the clip's gain is the one that leaves the least.
        gain = float(np.vdot(sum_mn, self.clip.audio_mn) / np.vdot(sum_mn, sum_mn))
        noise_mn = self.clip.audio_mn - gain * sum_mn
        return np.concatenate([gain * images_smn, noise_mn[None]])


def draw_mixture(simulator: SceneSimulator, index: int) -> TalkerMixture:
    """Scene ``index`` of a simulator."""
    scene = simulator.render(index)
    talkers = [person for person in scene.people if person.speaks]
    unit_vectors_sx = [
        [
            np.cos(person.mouth_elevation) * np.cos(person.azimuth),
            np.cos(person.mouth_elevation) * np.sin(person.azimuth),
            np.sin(person.mouth_elevation),
        ]
        for person in talkers
    ]
    return TalkerMixture(
        clip=scene.clip,
        azimuths=scene.labels.talker_azimuths,
        unit_vectors_sx=np.array(unit_vectors_sx),
        images_smn=simulator.render_talkers(index),
        direct_smn=simulator.render_direct(index),
    )


# One estimate for every talker, (N,); None for a talker who was missed.
Estimates = Sequence[npt.NDArray[np.float32] | None]


class SeparationMethod(Protocol):
    """One or several methods of separation that share their work."""

    def __call__(self, mixture: TalkerMixture) -> dict[str, Estimates]:
        """Estimates by the name of the method."""
        ...


@dataclass(frozen=True)
class DelayAndSumAtTruth:
    """Delay and sum, steered where the mouths are and in time with the reference microphone.

    Args:
        array: microphones.
        name: name of the method.
        stft: spectrogram in which they are delayed.
        reference: number of the reference microphone, from 0.
    """

    array: MicrophoneArray
    name: str = "delay and sum"
    stft: StftConfig = field(default_factory=lambda: SeparationConfig().stft)
    reference: int = 0

    def __call__(self, mixture: TalkerMixture) -> dict[str, Estimates]:
        audio_mn = torch.from_numpy(mixture.clip.audio_mn).double()
        x_fmt = stft(audio_mn[None], self.stft)[0]
        pressure = self.array.steering.model(self.array).pressure(mixture.unit_vectors_sx, self.stft.frequencies)
        steering_sfm = torch.from_numpy(pressure).transpose(0, 1)
        y_sft = torch.stack([delay_and_sum(x_fmt, steering_fm, self.reference) for steering_fm in steering_sfm])
        return {self.name: list(istft(y_sft, self.stft, audio_mn.shape[-1]).float().numpy())}


@dataclass(frozen=True)
class OracleMasks:
    """Ideal ratio masks, from each talker's own power at all microphones: an upper bound for estimated masks.

    Args:
        extractions: filters made of the masks, by the name of the method.
        stft: spectrogram of the masks.
        reference: number of the reference microphone, from 0.
    """

    extractions: Mapping[str, Extraction]
    stft: StftConfig = field(default_factory=lambda: SeparationConfig().stft)
    reference: int = 0

    def __call__(self, mixture: TalkerMixture) -> dict[str, Estimates]:
        audio_mn = torch.from_numpy(mixture.clip.audio_mn).double()
        x_fmt = stft(audio_mn[None], self.stft)[0]
        parts_sfmt = stft(torch.from_numpy(mixture.images_and_noise()), self.stft)
        power_sft = parts_sfmt.abs().square().mean(2)
        mask_sft = power_sft / power_sft.sum(0).clamp_min(torch.finfo(power_sft.dtype).tiny)
        talkers_sft = mask_sft[: len(mixture.azimuths)]
        estimates: dict[str, Estimates] = {}
        for name, extraction in self.extractions.items():
            y_sft = torch.stack([extraction(x_fmt, mask_ft, self.reference) for mask_ft in talkers_sft])
            estimates[name] = list(istft(y_sft, self.stft, audio_mn.shape[-1]).float().numpy())
        return estimates


@dataclass(frozen=True)
class PosteriorSeparation:
    """Sources localized and separated by the posterior, each assigned to the talker in its direction.

    Args:
        localizer: localizer of the mixtures.
        separators: filters by the name of the method.
        tolerance: largest angle between a talker and its source, radians.
    """

    localizer: Localizer
    separators: Mapping[str, Separator]
    tolerance: float = float(np.deg2rad(10.0))

    def __call__(self, mixture: TalkerMixture) -> dict[str, Estimates]:
        (localization,) = self.localizer.localize([mixture.clip])
        posterior, sources = localization.posterior, localization.sources
        found = [source.azimuth for source in sources]
        talkers, matched = gate_then_assign(angular_errors(mixture.azimuths, found), self.tolerance)
        source_of = dict(zip(talkers.tolist(), matched.tolist(), strict=True))
        estimates: dict[str, Estimates] = {}
        for name, separator in self.separators.items():
            sound_sn = separator.separate(mixture.clip.audio_mn, posterior, sources)
            estimates[name] = [
                sound_sn[source_of[talker]] if talker in source_of else None for talker in range(len(mixture.azimuths))
            ]
        return estimates


def default_methods(system: System, array: MicrophoneArray) -> list[SeparationMethod]:
    """Delay and sum at the truth, the refined and the one-pass posterior with several filters, and oracle masks."""
    plain = SeparationConfig()
    unfitted = SeparationConfig(rounds=0, reverberation=0.0)
    refined = {
        OURS: plain,
        "refined: MVDR": replace(plain, extraction=Mvdr()),
        "refined: masks alone": replace(plain, extraction=Masking()),
        "unfitted: Wiener": unfitted,
        "unfitted: MVDR": replace(unfitted, extraction=Mvdr()),
        "unfitted: masks alone": replace(unfitted, extraction=Masking()),
    }
    one_pass = {"one pass: Wiener": plain, "one pass: MVDR": replace(plain, extraction=Mvdr())}

    def separators(configs: Mapping[str, SeparationConfig]) -> dict[str, Separator]:
        return {name: Separator(system.config, config) for name, config in configs.items()}

    return [
        DelayAndSumAtTruth(array, BASELINE),
        PosteriorSeparation(Localizer(system, refinement=RefinementConfig()), separators(refined)),
        PosteriorSeparation(Localizer(system), separators(one_pass)),
        OracleMasks({"oracle masks: Wiener": plain.extraction, "oracle masks: MVDR": Mvdr()}),
    ]
