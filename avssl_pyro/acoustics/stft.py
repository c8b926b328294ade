"""Short-time Fourier transform and its inverse."""

import torch
from torch import Tensor

from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.errors import InputError


def stft(audio_bmn: Tensor, config: StftConfig) -> Tensor:
    """Computes the spectrogram x_bfmt, complex (B, F, M, T), of audio (B, M, N), with T = 1 + N // hop.

    Windows are centred on multiples of the hop.

    Raises:
        InputError: the audio is not longer than half a window.
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
    """Computes the audio (B, num_samples) whose spectrogram is nearest to x_bft (B, F, T).

    Raises:
        ValueError: the band is not the whole band, or windows overlap by less than half.
    """
    if config.bins != slice(0, config.window // 2 + 1, 1) or 2 * config.hop > config.window:
        raise ValueError(f"{config} cannot be inverted; give the whole band and a hop of at most half the window.")
    window = torch.hann_window(config.window, dtype=x_bft.real.dtype, device=x_bft.device)
    return torch.istft(x_bft, config.window, config.hop, window=window, center=True, length=num_samples)


def loud_frames(x_fmt: Tensor, below_db: float) -> Tensor:
    """Returns a mask, (T,), of the frames at most ``below_db`` decibels below the loudest frame.

    For digital silence the mask is True everywhere.

    Args:
        x_fmt: spectrogram, (F, M, T).
        below_db: range below the loudest frame, dB.
    """
    power_t = x_fmt.abs().square().mean((0, 1))
    return power_t >= power_t.max() * 10 ** (-below_db / 10)
