import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.errors import InputError
from avssl_pyro.models.tracking.detection import DetectionModel

MODEL = DetectionModel(found=0.8, clutter=0.3)
GRID = DirectionGrid(36)


def joint_likelihood(densities_sn: np.ndarray, sounding_s: np.ndarray) -> float:
    """Of N detections, summed over every way to explain them: each source causes one of them or none."""
    num_sources, num = densities_sn.shape
    total = 0.0
    for caused in itertools.product([None, *range(num)], repeat=num_sources):
        named = [n for n in caused if n is not None]
        if len(set(named)) < len(named):
            continue
        weight = MODEL.clutter_density ** (num - len(named))
        for s, n in enumerate(caused):
            weight *= 1 - MODEL.found * sounding_s[s] if n is None else MODEL.found * sounding_s[s] * densities_sn[s, n]
        total += weight
    return total


@given(st.integers(0, 3), st.floats(0.0, 1.0), st.integers(0, 2**16))
def test_ratio_beside_one_other_source_is_that_of_all_associations(num: int, sounding: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    density_nd = MODEL.density(GRID, rng.uniform(-np.pi, np.pi, num), rng.uniform(0.0, 0.5, num))
    other_d = rng.dirichlet(np.ones(36))
    other_n = density_nd @ other_d
    claims_n = MODEL.claims(MODEL.found * sounding * other_n, sounding)
    ratio_d = MODEL.missed + MODEL.ratio_terms(density_nd, claims_n).sum(0)
    without = joint_likelihood(other_n[None], np.array([sounding]))
    for d in (0, 17):
        together = joint_likelihood(np.stack([other_n, density_nd[:, d]]), np.array([sounding, 1.0]))
        assert ratio_d[d] == pytest.approx(together / without, rel=1e-9)


def test_density_is_one_over_the_circle_also_across_the_seam() -> None:
    azimuth_n = np.linspace(-np.pi, np.pi, 2000, endpoint=False)
    density_nd = MODEL.density(GRID, azimuth_n, np.full(2000, 0.6))
    np.testing.assert_allclose(density_nd.mean(0) * 2 * np.pi, 1.0, atol=1e-6)


def test_azimuths_are_trusted_no_further_than_the_least_error() -> None:
    azimuth_n = np.array([0.1, 0.1])
    density_nd = MODEL.density(GRID, azimuth_n, np.array([0.0, MODEL.least_std]))
    np.testing.assert_array_equal(density_nd[0], density_nd[1])


@pytest.mark.parametrize("wrong", [{"found": 1.0}, {"found": 0.0}, {"clutter": 0.0}, {"least_std": -1.0}])
def test_models_that_leave_nothing_to_infer_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match="detections found with probability"):
        DetectionModel(**wrong)
