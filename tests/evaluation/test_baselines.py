import numpy as np
import pytest
import torch

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering_kinds import MeasuredKind
from avssl_pyro.acoustics.stft import stft
from avssl_pyro.clip import CLIP_SAMPLES, SAMPLE_RATE, Clip
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.baselines import SrpPhat, default_baselines, subspace_sources
from avssl_pyro.evaluation.peaks import PeakSetting

GRID = DirectionGrid()
IMAGE = np.zeros((88, 288, 3), dtype=np.uint8)
ONE_PEAK = PeakSetting(0.5, 1)


def plane_waves(array, azimuths_deg, noise=0.03, seed=0):
    """A clip of white sources far away, heard earlier by microphones nearer to them."""
    rng = np.random.default_rng(seed)
    frequencies = np.fft.rfftfreq(CLIP_SAMPLES, 1 / SAMPLE_RATE)
    audio_mn = np.zeros((array.num_microphones, CLIP_SAMPLES))
    for azimuth in np.deg2rad(azimuths_deg):
        lead_m = array.positions @ [np.cos(azimuth), np.sin(azimuth), 0.0] / array.speed_of_sound
        source_f = np.fft.rfft(rng.standard_normal(CLIP_SAMPLES))
        audio_mn += np.fft.irfft(source_f * np.exp(2j * np.pi * frequencies * lead_m[:, None]), CLIP_SAMPLES)
    audio_mn += noise * rng.standard_normal(audio_mn.shape)
    return Clip("waves", (0.1 * audio_mn).astype(np.float32), IMAGE)


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("azimuth_deg", [90.0, -37.5, 178.0])
@pytest.mark.parametrize("name", ["circle4", "circle6"])
def test_a_plane_wave_is_found_where_it_comes_from(name, azimuth_deg, index):
    baseline = default_baselines(PRESETS[name], GRID)[index]
    [found] = baseline.decide(baseline.observe(plane_waves(PRESETS[name], [azimuth_deg])), ONE_PEAK)
    assert abs(np.rad2deg(wrap_angle(found - np.deg2rad(azimuth_deg)))) <= 2.5


def test_two_microphones_leave_left_and_right_open():
    # They lie on the x axis, so 60 and -60 degrees sound the same.
    array = PRESETS["circle2"]
    srp = default_baselines(array, GRID)[0]
    found = srp.decide(srp.observe(plane_waves(array, [60.0])), PeakSetting(0.9, 2))
    assert sorted(np.rad2deg(found)) == pytest.approx([-60, 60], abs=2.5)


def test_two_sources_are_both_found_when_the_true_number_is_unknown():
    array = PRESETS["circle6"]
    for baseline in default_baselines(array, GRID):
        spectrum_d = baseline.observe(plane_waves(array, [87.5, -32.5], noise=1.0))
        found = np.rad2deg(baseline.decide(spectrum_d, PeakSetting(0.5, 3)))
        assert sorted(found) == pytest.approx([-32.5, 87.5], abs=3), baseline.name


@pytest.mark.parametrize("name", ["circle2", "circle4", "circle6"])
def test_silence_a_dead_microphone_and_a_noiseless_wave_stay_finite(name):
    array = PRESETS[name]
    silent = Clip("silent", np.zeros((array.num_microphones, CLIP_SAMPLES), dtype=np.float32), IMAGE)
    noiseless = plane_waves(array, [92.5], noise=0.0)
    dead = Clip("dead", noiseless.audio_mn.copy(), IMAGE)
    dead.audio_mn[0] = 0
    for baseline in default_baselines(array, GRID):
        assert len(baseline.decide(baseline.observe(silent), PeakSetting(0.05, 4))) == 0
        assert np.isfinite(baseline.observe(dead)).all()
        found = baseline.decide(baseline.observe(noiseless), PeakSetting(0.9, 2))
        assert min(abs(np.rad2deg(found) - 92.5)) <= 2.5


def test_a_clip_does_not_depend_on_those_before_it_nor_on_the_number_of_processes():
    array = PRESETS["circle4"]
    clips = [plane_waves(array, [azimuth_deg], seed=seed) for seed, azimuth_deg in enumerate([10, 100, -100])]
    for alone, together in zip(default_baselines(array, GRID), default_baselines(array, GRID, workers=2), strict=True):
        expected = [alone.observe(clip) for clip in reversed(clips)][::-1]
        np.testing.assert_array_equal(together.observe_all(iter(clips)), expected)


def test_baselines_see_the_spectrogram_of_the_model():
    clip = plane_waves(PRESETS["circle4"], [30.0])
    baseline = default_baselines(PRESETS["circle4"], GRID)[0]
    x_fmt = stft(torch.from_numpy(clip.audio_mn).double()[None], baseline.stft_config)[0].numpy()
    window_sum = baseline.stft_config.window / 2
    np.testing.assert_allclose(baseline.spectrogram(clip) * window_sum, x_fmt.transpose(1, 0, 2), atol=1e-9)


def test_channels_must_match_the_array():
    baseline = default_baselines(PRESETS["circle6"], GRID)[0]
    with pytest.raises(InputError, match="clip 'waves': it has 4 channels but array 'circle6' has 6"):
        baseline.observe(plane_waves(PRESETS["circle4"], [0.0]))


def test_the_signal_subspace_has_the_size_the_paper_used():
    sizes = [subspace_sources(PRESETS[name]) for name in ("circle2", "circle4", "circle6", "circle246")]
    assert sizes == [1, 2, 3, 3]


@pytest.fixture(params=["starss23-mic", "starss23-foa", "measured"])
def other_kind(request, write_sofa):
    if request.param != "measured":
        return PRESETS[request.param]
    sofa = write_sofa(PRESETS["circle4"], np.rad2deg(GRID.azimuths))
    return MicrophoneArray("measured", steering=MeasuredKind.read(sofa))


def test_every_kind_of_array_is_searched_by_its_own_steering_vectors(other_kind):
    rng = np.random.default_rng(0)
    num_samples, direction = 4096, 50
    a_fdm = other_kind.steering_vectors(GRID, np.fft.rfftfreq(num_samples, 1 / SAMPLE_RATE)).numpy()
    audio_mn = np.fft.irfft(np.fft.rfft(rng.standard_normal(num_samples)) * a_fdm[:, direction].T)
    audio_mn += 0.03 * rng.standard_normal(audio_mn.shape)
    clip = Clip("white", (0.1 * audio_mn).astype(np.float32), IMAGE)
    baselines = default_baselines(other_kind, GRID)
    assert len(baselines) == (2 if other_kind.name == "starss23-foa" else 3)
    for baseline in baselines:
        assert abs(int(baseline.observe(clip).argmax()) - direction) <= 1, baseline.name


def test_srp_phat_of_ambisonics_is_refused():
    with pytest.raises(InputError, match=r"needs delays .* 'starss23-foa' records in first-order .* use MUSIC"):
        SrpPhat(PRESETS["starss23-foa"], GRID)
