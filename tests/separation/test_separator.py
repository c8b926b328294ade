from dataclasses import replace

import numpy as np
import pytest
import torch
from anechoic import Scene, scene, unit_vector

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.stft import istft, stft
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.separation_metrics import si_sdr
from avssl_pyro.separation.beamforming import Extraction, Masking, Mvdr, WienerFilter, delay_and_sum
from avssl_pyro.separation.separator import SeparationConfig, Separator
from avssl_pyro.systems.system import SystemConfig

AZIMUTHS_DEG = (40.0, -100.0)


def system(array: MicrophoneArray) -> SystemConfig:
    # The system looks at a part of the band; separated sound has all of it.
    return SystemConfig(array, stft=StftConfig(hop=256, low_hz=200.0, high_hz=4000.0, bin_step=2))


def delayed_and_summed(array: MicrophoneArray, mixed: Scene, azimuth_deg: float) -> np.ndarray:
    config = StftConfig(1024, 256)
    x_fmt = stft(torch.from_numpy(mixed.audio_mn).double()[None], config)[0]
    toward = unit_vector(np.deg2rad(azimuth_deg))[None]
    steering_fm = torch.from_numpy(array.steering.model(array).pressure(toward, config.frequencies)[:, 0])
    return istft(delay_and_sum(x_fmt, steering_fm, 0)[None], config, mixed.audio_mn.shape[1])[0].numpy()


@pytest.mark.parametrize(
    ("name", "extraction"),
    [
        ("circle2", WienerFilter()),
        ("circle6", WienerFilter()),
        ("circle4", WienerFilter()),
        ("circle4", Mvdr()),
        ("circle4", Masking()),
    ],
)
def test_each_voice_comes_out_cleaner_than_by_delay_and_sum(name: str, extraction: Extraction) -> None:
    array = PRESETS[name]
    mixed = scene(array, AZIMUTHS_DEG)
    sound_sn = Separator(system(array), SeparationConfig(extraction=extraction)).separate(
        mixed.audio_mn, mixed.posterior, mixed.sources
    )
    assert sound_sn.shape == (2, 16_000)
    assert sound_sn.dtype == np.float32
    for source, sound_n in zip(mixed.sources, sound_sn, strict=True):
        truth_n = mixed.images_smn[source.source_class, 0]
        summed_n = delayed_and_summed(array, mixed, AZIMUTHS_DEG[source.source_class])
        assert si_sdr(sound_n, truth_n) > si_sdr(summed_n, truth_n) + 3
        # In scale and in time with the reference microphone as well.
        assert np.mean((sound_n - truth_n) ** 2) < 0.3 * np.mean(truth_n**2)


def test_the_reference_microphone_can_be_chosen() -> None:
    array = PRESETS["circle4"]
    mixed = scene(array, AZIMUTHS_DEG)
    for reference in (0, 2):
        separator = Separator(system(array), SeparationConfig(reference=reference))
        sound_n = separator.separate(mixed.audio_mn, mixed.posterior, mixed.sources)[0]
        images_mn = mixed.images_smn[mixed.sources[0].source_class]
        scores = [si_sdr(sound_n, images_mn[m]) for m in range(4)]
        assert int(np.argmax(scores)) == reference


@pytest.mark.parametrize("num_samples", [1600, 4001, 16_255])
def test_sound_is_as_long_as_the_clip(num_samples: int) -> None:
    mixed = scene(PRESETS["circle2"], AZIMUTHS_DEG, num_samples)
    sound_sn = Separator(system(PRESETS["circle2"])).separate(mixed.audio_mn, mixed.posterior, mixed.sources)
    assert sound_sn.shape == (2, num_samples)
    assert np.isfinite(sound_sn).all()


def test_one_source_alone_keeps_what_was_heard() -> None:
    array = PRESETS["circle4"]
    mixed = scene(array, (70.0,))
    (sound_n,) = Separator(system(array)).separate(mixed.audio_mn, mixed.posterior, mixed.sources)
    assert si_sdr(sound_n, mixed.images_smn[0, 0]) > 20


def test_silence_no_source_and_a_dead_microphone() -> None:
    array = PRESETS["circle4"]
    mixed = scene(array, AZIMUTHS_DEG)
    separator = Separator(system(array))
    assert separator.separate(mixed.audio_mn, mixed.posterior, ()).shape == (0, 16_000)
    assert not separator.separate(np.zeros_like(mixed.audio_mn), mixed.posterior, mixed.sources).any()
    dead_mn = mixed.audio_mn.copy()
    dead_mn[3] = 0
    sound_sn = separator.separate(dead_mn, mixed.posterior, mixed.sources)
    for source, sound_n in zip(mixed.sources, sound_sn, strict=True):
        assert si_sdr(sound_n, mixed.images_smn[source.source_class, 0]) > 3


def test_louder_recordings_give_louder_sound_and_nothing_else() -> None:
    array = PRESETS["circle2"]
    mixed = scene(array, AZIMUTHS_DEG)
    separator = Separator(system(array))
    sound_sn, quiet_sn = (
        separator.separate(np.float32(gain) * mixed.audio_mn, mixed.posterior, mixed.sources) for gain in (1, 1e-4)
    )
    np.testing.assert_allclose(1e4 * quiet_sn, sound_sn, atol=1e-4 * np.abs(sound_sn).max())


def test_a_merged_source_has_the_sound_of_both_its_classes() -> None:
    """Two voices 8 degrees apart are one object; what is separated is both of them."""
    array = PRESETS["circle6"]
    mixed = scene(array, (36.0, 44.0, -100.0))
    merged = next(source for source in mixed.sources if source.merged_classes)
    assert set(merged.classes) == {0, 1}
    sound_sn = Separator(system(array)).separate(mixed.audio_mn, mixed.posterior, mixed.sources)
    both_n = mixed.images_smn[:2, 0].sum(0)
    of_one = replace(merged, merged_classes=())
    alone_sn = Separator(system(array), SeparationConfig(rounds=0, reverberation=0.0)).separate(
        mixed.audio_mn, mixed.posterior, [of_one]
    )
    together = si_sdr(sound_sn[mixed.sources.index(merged)], both_n)
    assert together > si_sdr(alone_sn[0], both_n) + 1
    assert together > 6


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"rounds": -1}, "rounds is -1"),
        ({"reference": -1}, "reference is -1"),
        ({"reverberation": 1.5}, "reverberation is 1.5"),
        ({"hop": 600}, "a hop of 600 samples does not go with a window of 1024"),
        ({"hop": 0}, "a hop of 0 samples"),
    ],
)
def test_impossible_settings_are_refused(settings: dict[str, float], says: str) -> None:
    with pytest.raises(InputError, match=says):
        SeparationConfig(**settings)  # type: ignore[arg-type]


def test_a_reference_that_the_array_lacks_and_a_short_clip_are_refused() -> None:
    array = PRESETS["circle2"]
    with pytest.raises(InputError, match="reference is 2, but array 'circle2' has 2 microphones; give 0 to 1"):
        Separator(system(array), SeparationConfig(reference=2))
    mixed = scene(array, AZIMUTHS_DEG)
    with pytest.raises(InputError, match="500 samples is too short"):
        Separator(system(array)).separate(mixed.audio_mn[:, :500], mixed.posterior, mixed.sources)
