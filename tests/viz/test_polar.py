import io

import cv2
import numpy as np
import pytest

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.clip import SceneLabels
from avssl_pyro.errors import InputError
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource
from avssl_pyro.viz.polar import Circle, draw_circles, draw_patterns

GRID = DirectionGrid()


def picture(figure):
    """RGB pixels of the figure, as a notebook shows them."""
    encoded = io.BytesIO()
    figure.savefig(encoded, format="png")
    image_ijc = cv2.imdecode(np.frombuffer(encoded.getvalue(), np.uint8), cv2.IMREAD_COLOR)
    return image_ijc[..., ::-1].astype(int)


def middle_of_color(figure):
    """Row and column of the middle of all coloured pixels, from the middle of the figure, up and left positive."""
    image_ijc = picture(figure)
    rows, columns = np.nonzero(np.ptp(image_ijc, axis=-1) > 60)
    return image_ijc.shape[0] / 2 - rows.mean(), image_ijc.shape[1] / 2 - columns.mean()


def largest_radius(ax):
    return max(path.vertices[:, 1].max() for wedges in ax.collections for path in wedges.get_paths())


def peaked(azimuth_deg):
    weights_d = np.full(GRID.num_directions, 1e-4)
    weights_d[int(GRID.nearest(np.deg2rad(azimuth_deg)))] = 1.0
    return weights_d


@pytest.mark.parametrize(("azimuth_deg", "up", "left"), [(2, 1, 0), (88, 0, 1), (-92, 0, -1), (178, -1, 0)])
def test_ahead_is_up_and_left_is_left(azimuth_deg, up, left):
    rose = draw_circles({"": Circle([peaked(azimuth_deg)])})
    offset_d = DirectionGrid(360).azimuths - np.deg2rad(azimuth_deg)
    beam = draw_patterns({"": {"beam": np.cos(offset_d / 2) ** 16}})
    beam.legends[0].remove()
    for figure in (rose, beam):
        found = np.array(middle_of_color(figure))
        assert found @ [up, left] > 20
        assert abs(found @ [left, up]) < 8


def test_the_wedges_of_a_class_are_as_large_as_its_level():
    weights_kd = np.stack([peaked(40), np.ones(GRID.num_directions), 7 * peaked(-100)])
    circle = Circle(weights_kd, [0.2, 0.5, 0.3])
    np.testing.assert_allclose((circle.radius_kd**2).sum(-1), [0.2, 0.5, 0.3])
    # Neither the scale of weights nor that of levels matters.
    np.testing.assert_allclose(Circle(3 * weights_kd, [2, 5, 3]).radius_kd, circle.radius_kd)
    assert not Circle(np.zeros((1, 72))).radius_kd.any()


def test_sources_and_the_truth_are_drawn():
    posterior = ClipPosterior(
        np.stack([peaked(40), peaked(-60)]), np.array([0.6, 0.4]), np.full(2, 0.01), np.full(2, 0.03)
    )
    source = LocalizedSource(azimuth=3.1, azimuth_std=0.1, level=0.6, level_std=0.01, direct_level=0.5, source_class=1)
    bare = picture(draw_circles({"": Circle.of(posterior)}))
    with_source = picture(draw_circles({"": Circle.of(posterior, [source])}))
    with_truth = picture(draw_circles({"": Circle.of(posterior, [source], SceneLabels((0.7,), (-2.0,)))}))
    assert bare.shape == with_source.shape == with_truth.shape
    # The arc crosses the seam at 180 degrees, low in the middle.
    rows, columns = np.nonzero((bare != with_source).any(-1))
    height, width = bare.shape[:2]
    assert rows.min() > height / 2
    assert columns.min() < width / 2 < columns.max()
    rows, columns = np.nonzero((with_truth != with_source).any(-1))
    assert columns.min() < 0.4 * width
    assert columns.max() > 0.6 * width


def test_circles_stand_side_by_side_on_one_scale():
    one = picture(draw_circles({"a": Circle([peaked(0)])}))
    five = picture(draw_circles({name: Circle([peaked(0)]) for name in "abcde"}, columns=3))
    assert five.shape[1] == pytest.approx(3 * one.shape[1], abs=3)
    assert five.shape[0] == pytest.approx(2 * one.shape[0], abs=3)
    sharp, wide = peaked(0), np.ones(72)
    alone, beside = draw_circles({"wide": Circle([wide])}), draw_circles({"wide": Circle([wide]), "b": Circle([sharp])})
    heights = [largest_radius(figure.axes[0]) for figure in (alone, beside)]
    assert heights[0] == pytest.approx(1.0)
    assert heights[1] == pytest.approx(72**-0.5, rel=0.01)


def test_patterns_that_share_their_lines_share_a_legend():
    power_d = np.ones(72)
    shared = draw_patterns({"a": {"1 kHz": power_d}, "b": {"1 kHz": power_d}})
    assert len(shared.legends) == 1
    apart = draw_patterns({"a": {"1 kHz": power_d}, "b": {"2 kHz": 0 * power_d}})
    assert not apart.legends
    assert all(ax.get_legend() is not None for ax in apart.axes)


def test_what_cannot_be_drawn_is_told():
    with pytest.raises(InputError, match="nothing to draw"):
        draw_circles({})
    with pytest.raises(InputError, match="nothing to draw"):
        draw_patterns({})
    with pytest.raises(InputError, match=r"weights of shape \(72,\)"):
        draw_circles({"": Circle(np.ones(72))})
    with pytest.raises(InputError, match=r"levels of shape \(3,\)"):
        draw_circles({"": Circle(np.ones((2, 72)), np.ones(3))})
    with pytest.raises(InputError, match="at least 0"):
        draw_circles({"": Circle(-np.ones((1, 72)))})
    with pytest.raises(InputError, match="floor_db is 3"):
        draw_patterns({"": {"": np.ones(72)}}, floor_db=3)
