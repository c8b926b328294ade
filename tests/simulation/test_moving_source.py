import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.clip import SAMPLE_RATE, Clip
from avssl_pyro.evaluation.baselines import default_baselines
from avssl_pyro.evaluation.peaks import PeakSetting
from avssl_pyro.simulation.motion import MovingTalkers
from avssl_pyro.simulation.moving_source import MovingAudioConfig, render_moving_talkers

ARRAY = PRESETS["circle4"]
CONFIG = MovingAudioConfig(snr_db=60.0)


def walk(sounding_t: npt.NDArray[np.bool_]) -> MovingTalkers:
    """One talker from +160 degrees across the seam to -170."""
    times_t = np.arange(len(sounding_t)) * 0.1
    azimuth_t = np.deg2rad(np.linspace(160.0, 190.0, len(sounding_t)))
    return MovingTalkers(times_t, azimuth_t[None], sounding_t[None])


def test_sound_comes_from_where_the_talker_is_at_the_time() -> None:
    talkers = walk(np.ones(20, dtype=bool))
    audio_mn = render_moving_talkers(talkers, ARRAY, CONFIG, np.random.default_rng(0))
    assert audio_mn.shape == (4, 2 * SAMPLE_RATE)
    assert audio_mn.dtype == np.float32
    srp_phat, *_ = default_baselines(ARRAY, DirectionGrid(72))
    image_ijc = np.zeros((88, 288, 3), dtype=np.uint8)
    for first_s in (0.1, 1.4):
        first = round(first_s * SAMPLE_RATE)
        clip = Clip("", audio_mn[:, first : first + SAMPLE_RATE // 2], image_ijc)
        (azimuth,) = srp_phat.decide(srp_phat.observe(clip), PeakSetting(0.5, 1))
        truth_deg = np.interp(first_s + 0.25, [0.0, 1.9], [160.0, 190.0])
        assert abs((np.rad2deg(azimuth) - truth_deg + 180) % 360 - 180) < 8.0


def test_pauses_are_silent_but_for_the_room_and_the_noise() -> None:
    sounding_t = np.arange(20) < 8
    audio_mn = render_moving_talkers(walk(sounding_t), ARRAY, CONFIG, np.random.default_rng(0))
    power_t = np.square(audio_mn).reshape(4, 20, -1).mean((0, 2))
    assert power_t[12:].max() < 1e-3 * power_t[:8].mean()


def test_nobody_sounding_is_silence() -> None:
    audio_mn = render_moving_talkers(walk(np.zeros(5, dtype=bool)), ARRAY, CONFIG, np.random.default_rng(0))
    assert not audio_mn.any()
