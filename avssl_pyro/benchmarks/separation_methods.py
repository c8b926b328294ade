"""Ways to take talkers out of a simulated mixture: from the truth, to compare with, and from a posterior."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt
import torch

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.stft import istft, stft
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.benchmarks.talker_mixtures import TalkerMixture
from avssl_pyro.evaluation.matching import angular_errors, gate_then_assign
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.localization.posterior import SourceThresholds, select_sources
from avssl_pyro.separation.beamforming import Extraction, delay_and_sum
from avssl_pyro.separation.separator import SeparationConfig, Separator

# One estimate for every talker, (N,); None for a talker who was missed.
Estimates = Sequence[npt.NDArray[np.float32] | None]


class SeparationMethod(Protocol):
    """Separates a mixture in one or several ways."""

    def __call__(self, mixture: TalkerMixture) -> dict[str, Estimates]:
        """The estimates of every way, by its name."""
        ...


@dataclass(frozen=True)
class DelayAndSumAtTruth:
    """Delay and sum, steered where the mouths are and in time with the reference microphone.

    Args:
        array: the microphones.
        name: of this way.
        stft: in which they are delayed.
        reference: microphone, counted from 0.
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
    """Ideal ratio masks, from each talker's own power at all microphones: what no estimate of masks can know.

    Args:
        extractions: what is done with them, by the names of the ways.
        stft: in which they are masks.
        reference: microphone, counted from 0.
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
    """Sources localized and separated by the posterior, each given to the talker in whose direction it was found.

    Args:
        localizer, thresholds: find the sources.
        separators: by the names of the ways.
        tolerance: a source farther from a talker is not this talker's, radians.
    """

    localizer: Localizer
    thresholds: SourceThresholds
    separators: Mapping[str, Separator]
    tolerance: float = float(np.deg2rad(10.0))

    def __call__(self, mixture: TalkerMixture) -> dict[str, Estimates]:
        (posterior,) = self.localizer.posteriors([mixture.clip])
        sources = select_sources(posterior, self.localizer.config.grid, self.thresholds)
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
