"""The short-time Fourier transform that turns a recording into the spectrogram the model explains."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor


@dataclass(frozen=True)
class StftConfig:
    """Hann-windowed STFT; the defaults are those of the paper's Sec. IV-A.

    Args:
        window: samples in a window.
        hop: samples between windows.
        sample_rate: Hz.
    """

    window: int = 512
    hop: int = 160
    sample_rate: int = 16_000

    @property
    def num_frequencies(self) -> int:
        return self.window // 2 + 1

    @property
    def frequencies(self) -> npt.NDArray[np.float64]:
        """Centre frequency of every bin, (F,), Hz."""
        return np.arange(self.num_frequencies) * self.sample_rate / self.window


def stft(audio_bmn: Tensor, config: StftConfig) -> Tensor:
    """Spectrogram x_bfmt, complex (B, F, M, T), of audio (B, M, N) with T = 1 + N // hop centred windows.

    Raises:
        ValueError: the audio is too short to centre one window on it.
    """
    b, m, n = audio_bmn.shape
    if n <= config.window // 2:
        raise ValueError(f"audio of {n} samples is too short for an STFT window of {config.window}.")
    window = torch.hann_window(config.window, dtype=audio_bmn.dtype, device=audio_bmn.device)
    x_ft = torch.stft(
        audio_bmn.reshape(b * m, n), config.window, config.hop, window=window, center=True, return_complex=True
    )
    return x_ft.reshape(b, m, *x_ft.shape[-2:]).transpose(1, 2).contiguous()
