"""Likelihood of a recording under an array with unknown directions.

The likelihood ranks arrays, channel orders and delays. Every excerpt is a mixture over directions of the model's
likelihood with one template each, plus a diffuse class.
With H = a a^H + eps I the profiled density (Eqs. 15, 16) has by Sherman and Morrison the closed form
``- M log(|x|^2 - |a^H x|^2 / (|a|^2 + eps)) - log(|a|^2 + eps) + const``.
A few rounds of EM fit the shares of the directions. A wrong array assigns the frequencies of one sound to different
directions, which lowers the likelihood.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.stft import stft
from avssl_pyro.acoustics.stft_config import StftConfig

DIFFUSE = 0.1
EM_ROUNDS = 5
# A share of zero in the first round would exclude a direction from all later ones.
LEAST_SHARE = 1e-6
LEAST_POWER_SHARE = 1e-8


@dataclass(frozen=True)
class FitConfig:
    """Frequencies, frames and directions of the fit.

    Args:
        num_azimuths: number of azimuths, evenly spread.
        elevations_deg: elevations of every azimuth in degrees.
        low_hz: lowest frequency in Hz.
        high_hz: highest frequency in Hz.
        frame_step: step between the frames used.
    """

    num_azimuths: int = 40
    elevations_deg: tuple[float, ...] = (0.0, 25.0)
    low_hz: float = 200.0
    high_hz: float = 3500.0
    frame_step: int = 4


@dataclass(frozen=True)
class TiltedGrid(DirectionGrid):
    """A direction grid at one elevation, in radians."""

    elevation: float = 0.0

    @property
    def unit_vectors(self) -> npt.NDArray[np.float64]:
        """Unit vectors towards the directions, (D, 3)."""
        level_dx = super().unit_vectors * np.cos(self.elevation)
        level_dx[:, 2] = np.sin(self.elevation)
        return level_dx


class Fit(NamedTuple):
    """Result of fitting an array to excerpts.

    Args:
        log_likelihood_b: mean log-likelihood per time-frequency bin in nats, (B,), up to a constant of the excerpt.
        responsibility_bftd: responsibility of each direction for each bin, (B, F, T, D); the rest to 1 is diffuse.
    """

    log_likelihood_b: npt.NDArray[np.float64]
    responsibility_bftd: Tensor


class Residual(NamedTuple):
    """Deviation of channels from their prediction by the other channels.

    Args:
        delay_s: delay in seconds; negative if early.
        agreement: mean cosine of the phase to the prediction at that delay, in [-1, 1]; negative if inverted.
    """

    delay_s: float
    agreement: float


class ArrayFit:
    """Fit of arrays, channel orders and delays to excerpts.

    Args:
        config: frequencies, frames and directions of the fit.
    """

    def __init__(self, config: FitConfig) -> None:
        self.config = config
        self._stft = StftConfig(low_hz=config.low_hz, high_hz=config.high_hz, bin_step=2)

    def spectrogram(self, audio_bmn: npt.NDArray[np.float32]) -> Tensor:
        """Returns the spectrogram x_bftm of the fit, with channels of equal power."""
        x_bfmt = stft(torch.from_numpy(audio_bmn), self._stft)[..., :: self.config.frame_step]
        power_m = x_bfmt.abs().square().mean((0, 1, 3))
        x_bfmt = x_bfmt / power_m.clamp_min(torch.finfo(power_m.dtype).tiny).sqrt()[:, None]
        return x_bfmt.transpose(-2, -1).contiguous()

    def steering(self, array: MicrophoneArray) -> Tensor:
        """Returns the array's steering vectors a_fdm of the directions."""
        grids = [TiltedGrid(self.config.num_azimuths, float(np.deg2rad(up))) for up in self.config.elevations_deg]
        per_elevation = [array.steering_vectors(grid, self._stft.frequencies) for grid in grids]
        return torch.cat(per_elevation, dim=1).to(torch.complex64)

    def fit(self, x_bftm: Tensor, steering_fdm: Tensor) -> Fit:
        """Fits shares of directions to a spectrogram of :meth:`spectrogram`."""
        m, num_directions = x_bftm.shape[-1], steering_fdm.shape[1]
        power_bft1 = x_bftm.abs().square().sum(-1, keepdim=True)
        power_bft1 = power_bft1 + LEAST_POWER_SHARE * power_bft1.mean((1, 2), keepdim=True).clamp_min(1e-30)
        # Factors common to all directions of a bin, such as its power, cancel in comparisons and are dropped.
        beam_bftd = (x_bftm @ steering_fdm.conj().transpose(-2, -1)).abs().square()
        norm_fd = steering_fdm.abs().square().sum(-1) + DIFFUSE
        left_bftd = 1 - beam_bftd / (power_bft1 * norm_fd[:, None])
        # log det H is (M - 1) log eps + log(|a|^2 + eps), and the quadratic form has 1 / eps before the bracket.
        bias_fd = float(np.log(DIFFUSE)) - norm_fd.log()
        log_density_bftd = bias_fd[:, None] - m * left_bftd.clamp_min(1e-6).log()
        # The diffuse class has H = I, and so a density of one in these units.
        log_density_bftd = torch.cat([log_density_bftd, torch.zeros_like(power_bft1)], dim=-1)
        share_bd = torch.full((x_bftm.shape[0], num_directions + 1), 0.5 / num_directions)
        share_bd[:, -1] = 0.5
        for _ in range(EM_ROUNDS):
            joint_bftd = log_density_bftd + share_bd.log()[:, None, None]
            responsibility_bftd = joint_bftd.softmax(-1)
            share_bd = responsibility_bftd.mean((1, 2)).clamp_min(LEAST_SHARE)
        evidence_bft = (log_density_bftd + share_bd.log()[:, None, None]).logsumexp(-1)
        return Fit(evidence_bft.mean((1, 2)).double().numpy(), responsibility_bftd[..., :-1])

    def residual(self, x_bftm: Tensor, steering_fdm: Tensor, compared: tuple[int, ...], longest_s: float) -> Residual:
        """Returns the deviation of channels from their prediction by the others.

        The other channels alone determine the directions. The mean phase between channels and prediction, over all bins
        and excerpts, is linear in frequency. Its slope gives the common delay and its sign the polarity.

        Args:
            x_bftm: spectrogram of :meth:`spectrogram`.
            steering_fdm: steering vectors of :meth:`steering`.
            compared: indices of the channels to compare, from 0.
            longest_s: longest delay of the search in seconds.
        """
        others = [m for m in range(x_bftm.shape[-1]) if m not in compared]
        fit = self.fit(x_bftm[..., others], steering_fdm[..., others])
        predicted_bftd = x_bftm[..., others] @ steering_fdm[:, :, others].conj().transpose(-2, -1)
        # Both beams point to the same direction, so their phases differ only by delay and polarity.
        compared_bftd = x_bftm[..., list(compared)] @ steering_fdm[:, :, list(compared)].conj().transpose(-2, -1)
        cross_bftd = compared_bftd * predicted_bftd.conj()
        size_bftd = cross_bftd.abs().clamp_min(1e-20)
        weighted_bftd = fit.responsibility_bftd * cross_bftd / size_bftd
        cross_f = weighted_bftd.sum((0, 2, 3)).numpy()
        total = float(fit.responsibility_bftd.sum())
        delay_s = np.arange(-longest_s, longest_s, 0.1 / self._stft.sample_rate)
        phase_sf = np.exp(2j * np.pi * delay_s[:, None] * self._stft.frequencies)
        agreement_s = (phase_sf @ cross_f).real / max(total, 1e-20)
        best = int(np.abs(agreement_s).argmax())
        return Residual(float(delay_s[best]), float(agreement_s[best]))
