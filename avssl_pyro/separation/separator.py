"""Separation of the localized sources of a clip by the masks of its posterior."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import torch

from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.acoustics.stft import istft, stft
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.distributions.profiled_gaussian import observe
from avssl_pyro.errors import InputError
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource
from avssl_pyro.separation.beamforming import Extraction, WienerFilter
from avssl_pyro.separation.masks import fitted_masks, masks_of_sources, posterior_masks
from avssl_pyro.systems.system import SystemConfig
from avssl_pyro.validators import at_least, within


@dataclass(frozen=True)
class SeparationConfig:
    """Settings of source separation.

    Args:
        window, hop: window and hop of the STFT in samples; its band is always the whole band. A window longer than the
            system's assigns more reverberation to its source.
        rounds: number of EM iterations that fit the masks to the clip; 0 uses the masks of the posterior.
        reverberation: share of the bins of no source that is divided among the sources, 0 to 1; lower it for noise.
        extraction: method of extraction by a mask.
        reference: number of the microphone at which the sources are estimated, counted from 0.

    Raises:
        InputError: a number is out of its range.
    """

    window: int = 1024
    hop: int = 256
    rounds: int = 2
    reverberation: float = 0.5
    extraction: Extraction = field(default_factory=WienerFilter)
    reference: int = 0

    def __post_init__(self) -> None:
        at_least(0).check(self, "rounds", "reference")
        within(0, 1).check(self, "reverberation")
        if not 0 < 2 * self.hop <= self.window:
            raise InputError(
                f"SeparationConfig: a hop of {self.hop} samples does not go with a window of {self.window}; give at "
                "most half the window."
            )

    @property
    def stft(self) -> StftConfig:
        return StftConfig(self.window, self.hop)


class Separator:
    """Separates the clips of one system, in double precision on the CPU.

    Args:
        system: configuration of the system of the posteriors; provides array, grid, diffuse power and room.
        config: settings of the separation.

    Raises:
        InputError: the array has no such reference microphone.

    >>> from avssl_pyro.api.model import load
    >>> result = load("circle4").localize(np.zeros((4, 16_000)))
    >>> separator = Separator(result.model.system.config)
    >>> separator.separate(result.clip.audio_mn, result.posterior, result.sources).shape
    (0, 16000)
    """

    def __init__(self, system: SystemConfig, config: SeparationConfig | None = None) -> None:
        self.config = SeparationConfig() if config is None else config
        num_microphones = system.array.num_microphones
        if self.config.reference >= num_microphones:
            raise InputError(
                f"SeparationConfig: reference is {self.config.reference}, but array '{system.array.name}' has "
                f"{num_microphones} microphones; give 0 to {num_microphones - 1}."
            )
        self._diffuse = system.model.diffuse
        whole_band = replace(system, stft=self.config.stft)
        room = whole_band.room()
        self._template_dfmm = (
            template_covariances(whole_band.steering(torch.complex128)) if room is None else room.template_jfmm
        )

    @torch.no_grad()
    def separate(
        self, audio_mn: npt.NDArray[np.float32], posterior: ClipPosterior, sources: Sequence[LocalizedSource]
    ) -> npt.NDArray[np.float32]:
        """Estimates every source at the reference microphone, float32 (S, N), in the order of ``sources``.

        Args:
            audio_mn: audio of the clip, (M, N), 16 kHz, in the order of the array's microphones.
            posterior: posterior of the clip.
            sources: sources selected from the posterior.

        Raises:
            InputError: the clip is not longer than half a window, or the posterior is of another room.
        """
        config, num_samples = self.config, audio_mn.shape[-1]
        if not sources:
            return np.zeros((0, num_samples), np.float32)
        x_fmt = stft(torch.from_numpy(audio_mn.astype(np.float64))[None], config.stft)[0]
        observed = observe(x_fmt)
        gamma_fkt = posterior_masks(observed, self._template_dfmm, posterior, self._diffuse)
        mask_fst = masks_of_sources(gamma_fkt, sources, config.reverberation)
        mask_fst = fitted_masks(observed, mask_fst, config.rounds)
        y_sft = torch.stack([config.extraction(x_fmt, mask_fst[:, s], config.reference) for s in range(len(sources))])
        return istft(y_sft, config.stft, num_samples).float().numpy()
