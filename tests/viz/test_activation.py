import numpy as np
import pytest

from avssl_pyro.viz.activation import blend_class_colors, resize_circular, strength_maps


def test_a_map_on_the_seam_grows_on_both_sides_alike():
    map_ij = np.zeros((4, 12), dtype=np.float32)
    map_ij[:, [0, -1]] = 1.0
    grown = resize_circular(map_ij, 8, 96)
    assert grown.shape == (8, 96)
    np.testing.assert_allclose(grown, grown[:, ::-1], atol=1e-6)
    assert grown[:, [0, -1]].min() == pytest.approx(1.0)


def test_resizing_keeps_places():
    column = np.arange(24)
    map_ij = np.tile(np.cos(2 * np.pi * (column + 0.5) / 24), (3, 1)).astype(np.float32)
    grown = resize_circular(map_ij, 6, 240)
    expected = np.cos(2 * np.pi * (np.arange(240) + 0.5) / 240)
    np.testing.assert_allclose(grown, np.tile(expected, (6, 1)), atol=0.01)


def test_activations_are_log_weights():
    weights = np.array([[0.1, 0.4], [0.2, 0.3]])
    strength = strength_maps(np.full((1, 72), 1 / 72), np.log(weights)[None] - 50)
    np.testing.assert_allclose(strength[0], weights / 0.4, rtol=1e-5)


def test_without_activations_weights_become_bands():
    weights_kd = np.eye(72)[[5, 7]] * 0.5
    strength = strength_maps(weights_kd, None)
    assert strength.shape == (2, 1, 72)
    assert strength.max(axis=(1, 2)).tolist() == [1.0, 1.0]
    assert strength.argmax(axis=-1).tolist() == [[5], [7]]


def test_emphasis_decides_how_much_of_a_color_is_seen():
    base = np.full((1, 3, 3), 0.5, dtype=np.float32)
    strength = np.array([[[1.0, 0.5, 0.0]]], dtype=np.float32)
    red = (1.0, 0.0, 0.0)
    np.testing.assert_array_equal(blend_class_colors(base, strength, [red], [0.0]), base)
    full, faint = blend_class_colors(base, strength, [red], [1.0]), blend_class_colors(base, strength, [red], [0.4])
    assert full[0, 0, 0] > full[0, 1, 0] > full[0, 2, 0] == 0.5
    assert full[0, 0, 0] > faint[0, 0, 0] > 0.5
