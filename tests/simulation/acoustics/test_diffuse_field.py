import os
import subprocess
import sys

import numpy as np
import numpy.typing as npt
import pytest

from avssl_pyro.acoustics.presets import PRESETS, uniform_circle
from avssl_pyro.simulation.acoustics.diffuse_field import diffuse_field, noise_frequencies

NUM_SAMPLES, FRAME = 160_000, 512


def covariance(audio_mn: npt.NDArray[np.float32]) -> npt.NDArray[np.complex128]:
    """Covariance between channels in every frequency bin, (F, M, M)."""
    frames_mtn = audio_mn[:, : len(audio_mn[0]) // FRAME * FRAME].reshape(len(audio_mn), -1, FRAME)
    x_fmt = np.fft.rfft(frames_mtn * np.hanning(FRAME), axis=-1).transpose(2, 0, 1)
    return x_fmt @ x_fmt.conj().swapaxes(-1, -2) / x_fmt.shape[-1]


def coherence(covariance_fmm: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
    level_fm = np.sqrt(np.einsum("fmm->fm", covariance_fmm).real)
    return covariance_fmm / level_fm[:, :, None] / level_fm[:, None, :]


@pytest.mark.parametrize("diameter_m", [0.05, 0.2, 1.5])
def test_coherence_in_free_field_is_a_sinc(diameter_m: float) -> None:
    array = uniform_circle(4, diameter_m, "array")
    found_fmm = coherence(covariance(diffuse_field(array).draw(NUM_SAMPLES, np.random.default_rng(0))))
    distance_mm = np.linalg.norm(array.positions[:, None] - array.positions, axis=-1)
    frequency_f = np.fft.rfftfreq(FRAME, 1 / 16000)
    expected_fmm = np.sinc(2 * frequency_f[:, None, None] * distance_mm / array.speed_of_sound)
    # 312 frames: a standard deviation of .06 per bin; a frame of 32 ms blurs the coherence of the widest array.
    bins = slice(3, -3)
    assert np.abs(found_fmm - expected_fmm)[bins].mean() < 0.06
    assert np.abs((found_fmm - expected_fmm)[bins].mean(axis=0)).max() < 0.03


@pytest.mark.parametrize("name", ["starss23-mic", "starss23-foa", "circle4"])
def test_covariance_is_that_of_waves_from_everywhere(name: str) -> None:
    array = PRESETS[name]
    found_fmm = covariance(diffuse_field(array).draw(NUM_SAMPLES, np.random.default_rng(1)))
    found_fmm /= np.sum(np.hanning(FRAME) ** 2)
    rng = np.random.default_rng(2)
    direction_dx = rng.standard_normal((4000, 3))
    direction_dx /= np.linalg.norm(direction_dx, axis=-1, keepdims=True)
    for bin_ in (8, 32, 96):
        a_dm = array.steering.model(array).pressure(direction_dx, np.array([bin_ * 16000 / FRAME]))[0]
        expected_mm = a_dm.T @ a_dm.conj() / len(a_dm)
        near_mm = found_fmm[bin_ - 2 : bin_ + 3].mean(axis=0)
        np.testing.assert_allclose(near_mm, expected_mm, atol=0.15 * np.abs(expected_mm).max())


def test_a_spectrum_shapes_the_noise() -> None:
    amplitude_f = np.where(noise_frequencies(16000) < 4000, 1.0, 0.1)
    noise_mn = diffuse_field(PRESETS["circle2"]).draw(16000, np.random.default_rng(0), amplitude_f)
    power_f = np.abs(np.fft.rfft(noise_mn, axis=-1)) ** 2
    ratio_db = 10 * np.log10(power_f[:, :3900].mean() / power_f[:, 4100:].mean())
    assert ratio_db == pytest.approx(20.0, abs=0.5)


def test_the_bits_do_not_depend_on_the_machines_threads() -> None:
    program = (
        "import hashlib, numpy as np;"
        "from avssl_pyro.acoustics.presets import PRESETS;"
        "from avssl_pyro.simulation.acoustics.diffuse_field import diffuse_field;"
        "noise_mn = diffuse_field(PRESETS['eigenmike32']).draw(2000, np.random.default_rng(0));"
        "print(hashlib.sha256(noise_mn.tobytes()).hexdigest())"
    )
    digests = {
        subprocess.check_output(
            [sys.executable, "-c", program], env={**os.environ, "OMP_NUM_THREADS": threads}, text=True
        )
        for threads in ("1", "3")
    }
    assert len(digests) == 1
