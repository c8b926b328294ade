import numpy as np
import pytest
import torch

from avssl_pyro.acoustics.stft import istft, loud_frames, stft
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.errors import InputError


def test_one_second_gives_257_bins_and_101_frames() -> None:
    x_bfmt = stft(torch.zeros(2, 3, 16_000), StftConfig())
    assert x_bfmt.shape == (2, 257, 3, 101)
    assert x_bfmt.dtype == torch.complex64


def test_frame_is_the_dft_of_the_windowed_samples_around_it() -> None:
    config = StftConfig(window=64, hop=20)
    audio_n = np.random.default_rng(0).standard_normal(400)
    x_ft = stft(torch.from_numpy(audio_n)[None, None], config)[0, :, 0]
    frame = 7
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(64) / 64)
    samples = audio_n[frame * 20 - 32 : frame * 20 + 32] * window
    expected_f = [np.sum(samples * np.exp(-2j * np.pi * f * np.arange(64) / 64)) for f in range(33)]
    assert x_ft[:, frame].numpy() == pytest.approx(np.array(expected_f))


def test_tone_peaks_in_the_bin_of_its_frequency_and_clips_stay_apart() -> None:
    config = StftConfig()
    tone_n = np.sin(2 * np.pi * 1000 * np.arange(4000) / config.sample_rate)
    audio = torch.zeros(2, 2, 4000, dtype=torch.float64)
    audio[1, 0] = torch.from_numpy(tone_n)
    power_bfm = stft(audio, config).abs().square().mean(-1)
    assert config.frequencies[int(power_bfm[1, :, 0].argmax())] == 1000.0
    assert power_bfm[0].max() == 0
    assert power_bfm[1, :, 1].max() == 0


@pytest.mark.parametrize("samples", [0, 1, 256])
def test_too_short_audio_is_refused(samples: int) -> None:
    with pytest.raises(ValueError, match=f"{samples} samples is too short .* window of 512"):
        stft(torch.zeros(1, 2, samples), StftConfig())


def test_a_band_is_the_same_bins_of_the_whole() -> None:
    audio_bmn = torch.randn(2, 3, 4000, generator=torch.Generator().manual_seed(0))
    band = StftConfig(low_hz=120.0, high_hz=4000.0, bin_step=2)
    whole = StftConfig()
    kept = [f for f, hertz in enumerate(whole.frequencies) if 120 <= hertz <= 4000][::2]
    assert band.frequencies.tolist() == whole.frequencies[kept].tolist()
    assert torch.equal(stft(audio_bmn, band), stft(audio_bmn, whole)[:, kept])


@pytest.mark.parametrize("num_samples", [300, 4000, 4096, 4111])
def test_the_inverse_gives_back_the_audio_to_the_sample(num_samples: int) -> None:
    config = StftConfig(window=256, hop=128)
    audio_bmn = torch.randn(2, 3, num_samples, generator=torch.Generator().manual_seed(0))
    x_bfmt = stft(audio_bmn, config)
    torch.testing.assert_close(istft(x_bfmt[:, :, 1], config, num_samples), audio_bmn[:, 1])


@pytest.mark.parametrize("config", [StftConfig(high_hz=4000.0), StftConfig(bin_step=2), StftConfig(hop=300)])
def test_what_left_something_out_has_no_inverse(config: StftConfig) -> None:
    x_bfmt = stft(torch.zeros(1, 1, 4000), config)
    with pytest.raises(ValueError, match="cannot be inverted"):
        istft(x_bfmt[:, :, 0], config, 4000)


def test_loud_frames_are_those_near_the_loudest() -> None:
    amplitude_t = torch.tensor([1.0, 0.5, 0.11, 0.09, 0.0])
    x_fmt = (amplitude_t * torch.ones(3, 2, 1)).to(torch.complex64)
    assert loud_frames(x_fmt, 20.0).tolist() == [True, True, True, False, False]
    assert loud_frames(0 * x_fmt, 20.0).all()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"low_hz": 5000.0, "high_hz": 4000.0}, "no bin of 31.25 Hz lies between 5000 and 4000 Hz"),
        ({"low_hz": 100.0, "high_hz": 110.0}, "no bin"),
        ({"bin_step": 0}, "step 0"),
        ({"window": 0}, "window of 0"),
        ({"hop": 0}, "hop of 0"),
        ({"sample_rate": 0}, "at 0 Hz"),
    ],
)
def test_impossible_settings_are_refused(settings: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        StftConfig(**settings)  # type: ignore[arg-type]
