import numpy as np
import pytest

from avssl_pyro.acoustics.ambisonics import FirstOrderAmbisonics
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS

GRID = DirectionGrid(360)
FREQUENCIES = np.array([0.0, 1000.0, 8000.0])


def gains(azimuth_deg: float, **options: str) -> list[float]:
    """Gains of a direction relative to those of W."""
    a_fdm = FirstOrderAmbisonics(**options)(GRID, FREQUENCIES).numpy()
    a_m = a_fdm[1, int(GRID.nearest(np.deg2rad(azimuth_deg)))].real
    omni = "WYZX".index("W")
    return [float(value) for value in a_m / a_m[omni]]


def test_gains_are_real_and_alike_at_all_frequencies() -> None:
    a_fdm = PRESETS["starss23-foa"].steering_vectors(GRID, FREQUENCIES).numpy()
    assert a_fdm.shape == (3, 360, 4)
    assert (a_fdm.imag == 0).all()
    assert (a_fdm == a_fdm[:1]).all()
    assert np.sum(np.abs(a_fdm) ** 2, axis=-1) == pytest.approx(np.full((3, 360), 4.0))


@pytest.mark.parametrize(
    ("azimuth_deg", "w_y_z_x"),
    [(0.5, [1, 0, 0, 1]), (90.5, [1, 1, 0, 0]), (-90.5, [1, -1, 0, 0]), (-179.5, [1, 0, 0, -1])],
)
def test_left_is_positive_in_y_and_ahead_in_x(azimuth_deg: float, w_y_z_x: list[float]) -> None:
    assert gains(azimuth_deg) == pytest.approx(w_y_z_x, abs=0.02)


def test_fuma_orders_x_y_z_and_has_a_quieter_w() -> None:
    assert gains(90.5, order="fuma") == pytest.approx([1, 0, 1, 0], abs=0.02)
    assert gains(90.5, order="fuma", normalization="maxn") == pytest.approx([1, 0, 2**0.5, 0], abs=0.02)
    assert gains(90.5, normalization="n3d") == pytest.approx([1, 3**0.5, 0, 0], abs=0.02)
