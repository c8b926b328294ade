"""The short-time Fourier transform that turns a recording into the spectrogram the model explains."""

import torch
from torch import Tensor

from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.errors import InputError


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
