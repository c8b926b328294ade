from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
import scipy.special
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.acoustics.presets import PRESETS, spherical_array
from avssl_pyro.acoustics.spherical import FirstOrderAmbisonics, RigidSphere, sphere_response
from avssl_pyro.acoustics.steering import FreeField

TETRAHEDRON = PRESETS["starss23-mic"]
GRID = DirectionGrid()
CylinderFunction = Callable[[float, float], complex]


def incident_and_scattered(ka: float, cosine: npt.NDArray[np.float64], terms: int) -> npt.NDArray[np.complex128]:
    """The plane wave's own series plus that of the scattered wave, from cylinder functions of half order."""

    def spherical(function: CylinderFunction, order: int) -> complex:
        return np.sqrt(np.pi / (2 * ka)) * function(order + 0.5, ka)

    def slope(function: CylinderFunction, order: int) -> complex:
        return order / ka * spherical(function, order) - spherical(function, order + 1)

    total = np.zeros(cosine.shape, dtype=np.complex128)
    for n in range(terms):
        bessel, hankel = spherical(scipy.special.jv, n), spherical(scipy.special.hankel2, n)
        scattered = slope(scipy.special.jv, n) / slope(scipy.special.hankel2, n) * hankel
        total += 1j**n * (2 * n + 1) * (bessel - scattered) * scipy.special.legendre(n)(cosine)
    return total


@given(st.floats(0.3, 6.5))
def test_response_is_the_incident_plus_the_scattered_wave(ka: float) -> None:
    cosine = np.linspace(-1, 1, 9)
    expected = incident_and_scattered(ka, cosine, terms=22)
    assert sphere_response(np.array([ka]), cosine)[0] == pytest.approx(expected, rel=1e-6, abs=1e-6)


@given(st.floats(0.0, 0.02), st.floats(-1.0, 1.0))
def test_a_tiny_sphere_turns_the_phase_by_half_as_much_again_as_free_field(ka: float, cosine: float) -> None:
    response = sphere_response(np.array([ka]), np.array(cosine))[0]
    # What is left out is of second order.
    assert abs(response - (1 + 1.5j * ka * cosine)) <= 2 * ka**2 + 1e-12


@given(st.floats(0.0, 1e-4))
def test_an_array_on_a_sphere_that_is_small_to_the_wave_hears_as_in_free_field(hz: float) -> None:
    on_sphere = RigidSphere(TETRAHEDRON, 0.042)(GRID, np.array([hz])).numpy()
    assert on_sphere == pytest.approx(FreeField(TETRAHEDRON)(GRID, np.array([hz])).numpy(), abs=1e-6)


@given(st.floats(0.1, 40.0))
def test_energy_is_that_of_the_series(ka: float) -> None:
    """The mean square over the sphere is the sum of squares of its orders (Parseval)."""
    nodes, weights = scipy.special.roots_legendre(128)
    power = weights @ np.abs(sphere_response(np.array([ka]), nodes)[0]) ** 2 / 2
    n = np.arange(90)
    with np.errstate(all="ignore"):
        slope = scipy.special.spherical_jn(n, ka, True) - 1j * scipy.special.spherical_yn(n, ka, True)
        order_power = (2 * n + 1) / (ka**4 * np.abs(slope) ** 2)
    assert power == pytest.approx(np.nansum(order_power), rel=1e-9)
    assert 0.5 < power < 4


def test_far_above_the_sphere_s_size_the_bright_side_doubles_and_the_dark_side_is_dark() -> None:
    bright, dark = np.abs(sphere_response(np.array([40.0]), np.array([1.0, -0.7]))[0])
    assert bright == pytest.approx(2, abs=0.05)
    assert dark < 0.5


def test_steering_vectors_have_the_norm_of_free_field_and_keep_levels_between_microphones() -> None:
    frequencies = np.array([0.0, 300.0, 2000.0, 8000.0])
    a_fdm = RigidSphere(TETRAHEDRON, 0.042)(GRID, frequencies).numpy()
    assert np.sum(np.abs(a_fdm) ** 2, axis=-1) == pytest.approx(np.full((4, 72), 4.0))
    cosine_dm = GRID.unit_vectors @ TETRAHEDRON.positions.T / 0.042
    raw_fdm = sphere_response(2 * np.pi * frequencies / 343 * 0.042, cosine_dm)
    assert a_fdm / a_fdm[..., :1] == pytest.approx(raw_fdm / raw_fdm[..., :1], rel=1e-5)


def test_below_1_khz_phases_are_about_one_and_a_half_times_those_of_free_field() -> None:
    frequencies = np.array([200.0, 500.0, 900.0])
    on_sphere = RigidSphere(TETRAHEDRON, 0.042)(GRID, frequencies).numpy()
    free = FreeField(TETRAHEDRON)(GRID, frequencies).numpy()
    turn, free_turn = (np.angle(a[..., 1:] * a[..., :1].conj()) for a in (on_sphere, free))
    ratio = turn[np.abs(free_turn) > 0.02] / free_turn[np.abs(free_turn) > 0.02]
    assert np.median(ratio) == pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize(("hz", "mean_deg"), [(500.0, 0.0), (3000.0, 0.0), (4000.0, 36.1)])
def test_free_field_templates_mistake_the_sphere_s_directions_at_4_khz_but_not_up_to_3(
    hz: float, mean_deg: float
) -> None:
    (on_sphere,) = RigidSphere(TETRAHEDRON, 0.042)(GRID, np.array([hz])).numpy()
    (free,) = FreeField(TETRAHEDRON)(GRID, np.array([hz])).numpy()
    best_d = np.abs(free.conj() @ on_sphere.T).argmax(axis=0)
    error_d = np.abs(wrap_angle(GRID.azimuths[best_d] - GRID.azimuths))
    assert np.rad2deg(error_d.mean()) == pytest.approx(mean_deg, abs=0.1)


def test_a_shifted_sphere_is_heard_as_one_at_the_origin_but_for_a_common_phase() -> None:
    shift = np.array([0.1, -0.05, 0.02])
    moved = MicrophoneArray("moved", tuple(map(tuple, (TETRAHEDRON.positions + shift).tolist())))
    frequencies = np.array([700.0, 5000.0])
    here = RigidSphere(TETRAHEDRON, 0.042)(GRID, frequencies).numpy()
    there = RigidSphere(moved, 0.042, (0.1, -0.05, 0.02))(GRID, frequencies).numpy()
    lead_d = GRID.unit_vectors @ shift / 343
    phase_fd = np.exp(2j * np.pi * frequencies[:, None] * lead_d)
    assert there == pytest.approx(here * phase_fd[..., None], abs=1e-9)


def test_the_microphone_that_faces_the_source_hears_it_first_and_loudest() -> None:
    array = spherical_array("four", ((0.0, 0.0), (90.0, 0.0), (180.0, 0.0), (-90.0, 0.0)))
    (a_dm,) = array.steering_vectors(GRID, np.array([1000.0])).numpy()
    left_m = a_dm[int(GRID.nearest(np.deg2rad(89.0)))]
    assert np.abs(left_m).argmax() == 1
    assert np.angle(left_m).argmax() == 1
    assert np.angle(left_m).argmin() == 3


FINE_GRID = DirectionGrid(360)
FREQUENCIES = np.array([0.0, 1000.0, 8000.0])


def gains(azimuth_deg: float, **options: str) -> list[float]:
    """Gains of a direction relative to those of W."""
    a_fdm = FirstOrderAmbisonics(**options)(FINE_GRID, FREQUENCIES).numpy()
    a_m = a_fdm[1, int(FINE_GRID.nearest(np.deg2rad(azimuth_deg)))].real
    omni = "WYZX".index("W")
    return [float(value) for value in a_m / a_m[omni]]


def test_gains_are_real_and_alike_at_all_frequencies() -> None:
    a_fdm = PRESETS["starss23-foa"].steering_vectors(FINE_GRID, FREQUENCIES).numpy()
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
