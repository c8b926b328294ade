import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.evaluation.separation_metrics import si_sdr

RANDOM = np.random.default_rng(0)
REFERENCE_N, ERROR_N = RANDOM.standard_normal((2, 1000))


@given(st.floats(1e-3, 1e3), st.floats(1e-3, 1e3), st.booleans())
def test_scales_and_signs_do_not_matter(first: float, second: float, negative: bool) -> None:
    estimate_n = REFERENCE_N + 0.5 * ERROR_N
    scaled_n = (-first if negative else first) * estimate_n
    assert si_sdr(scaled_n, second * REFERENCE_N) == pytest.approx(si_sdr(estimate_n, REFERENCE_N), abs=1e-6)


@pytest.mark.parametrize("level_db", [-20.0, 0.0, 30.0])
def test_it_is_the_level_over_an_orthogonal_error(level_db: float) -> None:
    orthogonal_n = ERROR_N - (ERROR_N @ REFERENCE_N) / (REFERENCE_N @ REFERENCE_N) * REFERENCE_N
    orthogonal_n *= np.linalg.norm(REFERENCE_N) / np.linalg.norm(orthogonal_n) * 10 ** (-level_db / 20)
    assert si_sdr(REFERENCE_N + orthogonal_n, REFERENCE_N) == pytest.approx(level_db, abs=1e-6)


def test_silence_is_as_bad_and_identity_as_good_as_can_be() -> None:
    assert si_sdr(np.zeros(10), REFERENCE_N[:10]) == pytest.approx(-100, abs=1e-3)
    assert si_sdr(REFERENCE_N[:10], np.zeros(10)) == pytest.approx(-100, abs=1e-3)
    assert si_sdr(REFERENCE_N, REFERENCE_N) == pytest.approx(100, abs=1e-3)
    assert si_sdr(REFERENCE_N.astype(np.float32), 2 * REFERENCE_N) > 90
