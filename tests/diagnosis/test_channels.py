import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.diagnosis.channels import check_clipping, check_levels, clipped_runs
from avssl_pyro.diagnosis.finding import Severity
from avssl_pyro.recordings.excerpts import Excerpts


@settings(max_examples=25, deadline=None)
@given(st.floats(100.0, 3000.0), st.floats(0.1, 1.0), st.sampled_from([16_000, 48_000]))
def test_a_modulated_tone_is_not_clipped_until_it_is(frequency_hz: float, level: float, rate: int) -> None:
    time_n = np.arange(rate) / rate
    wave_n = level * np.sin(2 * np.pi * frequency_hz * time_n) * (1 + 0.5 * np.sin(2 * np.pi * 2.3 * time_n)) / 1.5
    samples_n = (np.round(wave_n * 32767) / 32767).astype(np.float32)
    assert clipped_runs(samples_n[None])[0] < 4
    cut_n = samples_n.clip(-1, 0.2 * level)
    runs, at = clipped_runs(cut_n[None])
    assert runs >= 4
    assert at == pytest.approx(0.2 * level)


def test_a_faint_recording_of_few_levels_is_not_clipped() -> None:
    steps_n = np.random.default_rng(0).integers(-3, 4, 16_000) / 32768
    (finding,) = check_clipping(Excerpts.of_blocks(steps_n.astype(np.float32)[None, None], 16_000))
    assert finding.severity == Severity.OK


@pytest.mark.parametrize(("array", "named"), [("circle4", True), ("starss23-mic", True), ("starss23-foa", False)])
def test_a_gain_is_named_only_where_the_steering_leaves_it_free(array: str, named: bool) -> None:
    rng = np.random.default_rng(0)
    sound_bmn = np.repeat(0.1 * rng.standard_normal((2, 1, 16_000)), 4, axis=1)
    sound_bmn += 1e-3 * rng.standard_normal(sound_bmn.shape)
    sound_bmn[:, 1] *= 1.6
    (finding,) = check_levels(Excerpts.of_blocks(sound_bmn.astype(np.float32), 16_000), PRESETS[array])
    assert (finding.severity == Severity.WARNING) == named
    if named:
        assert finding.message == "channel 2 is 4 dB louder than the others"
