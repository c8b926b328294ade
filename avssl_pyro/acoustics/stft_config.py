"""Settings of the short-time Fourier transform."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class StftConfig:
    """Window, hop and band of an STFT with Hann windows; the defaults are those of the paper's Sec. IV-A.

    Args:
        window: length of a window, samples.
        hop: distance of neighbouring windows, samples.
        sample_rate: sample rate, Hz.
        low_hz, high_hz: least and greatest frequency of the band, Hz.
        bin_step: step between the bins of the band.

    >>> StftConfig().frequencies.shape
    (257,)
    >>> StftConfig(low_hz=200.0, high_hz=4000.0, bin_step=2).frequencies.shape
    (61,)
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
        """Bins of the band."""
        width = self.sample_rate / self.window
        first = max(0, math.ceil(self.low_hz / width))
        last = min(self.window // 2, math.floor(self.high_hz / width))
        return slice(first, last + 1, self.bin_step)

    @property
    def frequencies(self) -> npt.NDArray[np.float64]:
        """Frequencies of the band's bins, (F,), Hz."""
        return np.arange(self.window // 2 + 1)[self.bins] * self.sample_rate / self.window
