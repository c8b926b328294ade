"""The short-time Fourier transform that turns a recording into the spectrogram the model explains."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class StftConfig:
    """Hann-windowed STFT, of which a band may be kept; the defaults are those of the paper's Sec. IV-A.

    Args:
        window: samples in a window.
        hop: samples between windows.
        sample_rate: Hz.
        low_hz, high_hz: bins below and above are left out, and the model explains nothing of them.
        bin_step: every how many of the others are kept.
    """

    window: int = 512
    hop: int = 160
    sample_rate: int = 16_000
    low_hz: float = 0.0
    high_hz: float = 8_000.0
    bin_step: int = 1

    def __post_init__(self) -> None:
        if min(self.window // 2, self.hop, self.sample_rate) < 1:
            raise InputError(
                f"STFT: a window of {self.window} and a hop of {self.hop} samples at {self.sample_rate} Hz cannot be; "
                "give a window of at least 2, a hop and a sample rate of at least 1."
            )
        if self.bin_step < 1 or self.bins.stop <= self.bins.start:
            raise InputError(
                f"STFT band: no bin of {self.sample_rate / self.window:g} Hz lies between {self.low_hz:g} and "
                f"{self.high_hz:g} Hz with step {self.bin_step}; widen the band."
            )

    @property
    def bins(self) -> slice:
        """The bins that are kept."""
        width = self.sample_rate / self.window
        first = max(0, math.ceil(self.low_hz / width))
        last = min(self.window // 2, math.floor(self.high_hz / width))
        return slice(first, last + 1, self.bin_step)

    @property
    def frequencies(self) -> npt.NDArray[np.float64]:
        """Centre frequency of every kept bin, (F,), Hz."""
        return np.arange(self.window // 2 + 1)[self.bins] * self.sample_rate / self.window


def stft(audio_bmn: Tensor, config: StftConfig) -> Tensor:
    """Spectrogram x_bfmt, complex (B, F, M, T), of audio (B, M, N) with T = 1 + N // hop centred windows.

    Raises:
        InputError: the audio is too short to centre one window on it.
    """
    b, m, n = audio_bmn.shape
    if n <= config.window // 2:
        raise InputError(
            f"audio of {n} samples is too short for an STFT window of {config.window}; give more than half a window."
        )
    window = torch.hann_window(config.window, dtype=audio_bmn.dtype, device=audio_bmn.device)
    x_ft = torch.stft(
        audio_bmn.reshape(b * m, n), config.window, config.hop, window=window, center=True, return_complex=True
    )
    return x_ft.reshape(b, m, *x_ft.shape[-2:])[:, :, config.bins].transpose(1, 2).contiguous()


def istft(x_bft: Tensor, config: StftConfig, num_samples: int) -> Tensor:
    """Audio (B, num_samples) of spectrograms (B, F, T): what :func:`stft` came from, as near as one can get.

    Raises:
        ValueError: the band is not the whole one, or windows do not overlap enough to be undone.
    """
    if config.bins != slice(0, config.window // 2 + 1, 1) or 2 * config.hop > config.window:
        raise ValueError(f"{config} keeps too little to get back to audio: whole band and half-overlap are needed.")
    window = torch.hann_window(config.window, dtype=x_bft.real.dtype, device=x_bft.device)
    return torch.istft(x_bft, config.window, config.hop, window=window, center=True, length=num_samples)


def loud_frames(x_fmt: Tensor, below_db: float) -> Tensor:
    """Mask, (T,), of the frames of a spectrogram, (F, M, T), at most so many decibels below the loudest of them.

    All frames of digital silence are kept.
    """
    power_t = x_fmt.abs().square().mean((0, 1))
    return power_t >= power_t.max() * 10 ** (-below_db / 10)
