import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.channel_gains import EVEN_DB, ChannelGains, GainEstimator
from avssl_pyro.acoustics.presets import PRESETS

ARRAYS = ("circle2", "circle4", "circle6", "respeaker4", "starss23-mic")
ESTIMATORS = {name: GainEstimator(PRESETS[name]) for name in ARRAYS}


def recorded(
    array: MicrophoneArray, azimuths_deg: tuple[float, ...] = (20.0, 140.0), seed: int = 0, noise: float = 0.01
) -> npt.NDArray[np.float32]:
    """Independent noises as plane waves from these azimuths, with sensor noise, (M, N)."""
    rng = np.random.default_rng(seed)
    azimuth_d = np.deg2rad(azimuths_deg)
    unit_dx = np.stack([np.cos(azimuth_d), np.sin(azimuth_d), np.zeros(len(azimuth_d))], axis=-1)
    frequencies_hz = np.fft.rfftfreq(16_000, 1 / 16_000)
    pressure_fdm = array.steering.model(array).pressure(unit_dx, frequencies_hz)
    source_fd = np.fft.rfft(rng.standard_normal((16_000, len(azimuth_d))), axis=0)
    source_fd /= np.sqrt(1 + (frequencies_hz / 500) ** 2)[:, None]
    audio_mn = np.fft.irfft(np.einsum("fdm,fd->fm", pressure_fdm, source_fd), axis=0).T
    audio_mn /= 20 * audio_mn.std()
    return (audio_mn + noise / 20 * rng.standard_normal(audio_mn.shape)).astype(np.float32)


def altered(audio_mn: npt.NDArray[np.float32], gain_db_m: npt.ArrayLike, sign_m: npt.ArrayLike = 1.0) -> npt.NDArray:
    factor_m = np.asarray(sign_m) * 10 ** (np.asarray(gain_db_m) / 20)
    return (factor_m[:, None] * audio_mn).astype(np.float32)


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(ARRAYS), st.integers(0, 2**31), st.data())
def test_gains_and_signs_are_estimated_whatever_they_are(name: str, seed: int, data: st.DataObject) -> None:
    num = PRESETS[name].num_microphones
    gain_db_m = np.array(data.draw(st.lists(st.floats(-12, 12), min_size=num, max_size=num)))
    sign_m = np.array(data.draw(st.lists(st.sampled_from([-1.0, 1.0]), min_size=num, max_size=num)))
    azimuths_deg = tuple(np.random.default_rng(seed).uniform(-180, 180, 3))
    audio_mn = altered(recorded(PRESETS[name], azimuths_deg, seed), gain_db_m, sign_m)
    gains = ESTIMATORS[name].estimate(audio_mn[None])
    np.testing.assert_allclose(gains.gain_db_m, gain_db_m - np.median(gain_db_m), atol=1.2)
    turned_m = np.array(gains.turned_m)
    assert len(set(np.where(turned_m, -sign_m, sign_m))) == 1
    assert turned_m.sum() <= num / 2
    # Estimated again, nothing is left.
    assert ESTIMATORS[name].estimate(gains.compensated(audio_mn)[None]).are_even


@pytest.mark.parametrize("name", ARRAYS)
def test_audio_of_equal_gains_is_returned_as_it_is(name: str) -> None:
    audio_mn = recorded(PRESETS[name])
    gains = ESTIMATORS[name].estimate(audio_mn[None])
    assert gains.are_even
    assert gains.compensated(audio_mn) is audio_mn
    assert gains.remarks() == ()


def test_gains_within_the_dead_zone_are_left_alone() -> None:
    gains = ChannelGains((0.0, EVEN_DB - 0.1, 0.0), (False,) * 3, (False,) * 3)
    audio_mn = np.ones((3, 8), np.float32)
    assert gains.compensated(audio_mn) is audio_mn


def test_a_shadowed_microphone_of_a_rigid_sphere_is_not_softer() -> None:
    array = PRESETS["starss23-mic"]
    audio_mn = recorded(array, (45.0,))
    assert audio_mn.std(axis=1).max() > 1.1 * audio_mn.std(axis=1).min()
    gains = ESTIMATORS["starss23-mic"].estimate(altered(audio_mn, [0, 0, 0, 9])[None])
    np.testing.assert_allclose(gains.gain_db_m, [0, 0, 0, 9], atol=1.2)
    assert gains.remarks() == ("channel 4 is 9 dB louder than the others",)


@pytest.mark.parametrize("num", [1, 3])
def test_silence_has_equal_gains(num: int) -> None:
    silent_bmn = np.zeros((num, 4, 16_000), np.float32)
    assert ESTIMATORS["circle4"].estimate(silent_bmn) == ChannelGains.equal(4)


def test_a_dead_channel_has_no_gain_and_is_named() -> None:
    audio_mn = altered(recorded(PRESETS["circle4"]), [0, 6, 0, 0])
    audio_mn[2] = 0.0
    gains = ESTIMATORS["circle4"].estimate(audio_mn[None])
    assert gains.dead_m == (False, False, True, False)
    assert gains.gain_db_m[2] == 0
    assert gains.gain_db_m[1] == pytest.approx(6, abs=1.0)
    assert gains.remarks() == ("channel 3 is dead", "channel 2 is 6 dB louder than the others")
    assert np.isfinite(gains.compensated(audio_mn)).all()


def test_a_single_live_channel_has_nothing_to_be_compared_with() -> None:
    audio_mn = recorded(PRESETS["circle2"])
    audio_mn[1] = 0.0
    gains = ESTIMATORS["circle2"].estimate(audio_mn[None])
    assert gains.gain_db_m == (0.0, 0.0)
    assert gains.remarks() == ("channel 2 is dead",)


def test_ambisonics_are_left_as_their_format_has_them() -> None:
    array = PRESETS["starss23-foa"]
    audio_mn = altered(recorded(array), [-3, 0, 6, 0], [1, -1, 1, 1])
    gains = GainEstimator(array).estimate(audio_mn[None])
    assert gains == ChannelGains.equal(4)
    assert gains.compensated(audio_mn) is audio_mn


def test_noise_that_is_independent_in_every_microphone_turns_no_sign() -> None:
    noise_mn = np.random.default_rng(0).standard_normal((6, 16_000)).astype(np.float32)
    assert ESTIMATORS["circle6"].estimate(noise_mn[None]).are_even


def test_a_quiet_excerpt_does_not_decide() -> None:
    array = PRESETS["circle4"]
    loud_mn = altered(recorded(array), [0, 0, 9, 0])
    # Noise behind the gains, the same in every channel, is all that the other excerpts have.
    quiet_bmn = 1e-3 * np.random.default_rng(1).standard_normal((5, 4, 16_000)).astype(np.float32)
    gains = ESTIMATORS["circle4"].estimate(np.concatenate([quiet_bmn, loud_mn[None]]))
    assert gains.gain_db_m[2] == pytest.approx(9, abs=1.0)


def test_microphones_too_far_apart_have_no_sign_in_common() -> None:
    array = MicrophoneArray("wide", ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0)))
    audio_mn = altered(recorded(array), [0, 6], [1, -1])
    gains = GainEstimator(array).estimate(audio_mn[None])
    assert gains.turned_m == (False, False)
    assert gains.gain_db_m[1] - gains.gain_db_m[0] == pytest.approx(6, abs=1.0)


def test_two_channels_are_named_together() -> None:
    gains = ChannelGains((-2.5, 2.5), (False, True), (False, False))
    assert gains.remarks((4, 6)) == (
        "channel 7 is 5 dB louder than the other",
        "channels 5 and 7 have opposite signs",
    )
