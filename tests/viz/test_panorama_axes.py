import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.viz.panorama_axes import BoxSize, PanoramaAxes, place_boxes

CANVAS = PanoramaAxes(1152, 352)
SIZE = BoxSize(46, 23)


def test_columns_agree_with_the_direction_grid():
    columns = [CANVAS.column(azimuth) for azimuth in DirectionGrid(72).azimuths]
    assert columns == pytest.approx((np.arange(72) + 0.5) * 16)
    assert CANVAS.column(np.pi / 2) == pytest.approx(1152 / 4)


def test_what_crosses_the_seam_comes_back_on_the_other_side():
    assert list(CANVAS.copies(-5, 5)) == [0, 1152]
    assert list(CANVAS.copies(1150, 1160)) == [-1152, 0]
    assert list(CANVAS.copies(500, 510)) == [0]


anchors = st.lists(st.tuples(st.floats(0, 1152, exclude_max=True), st.floats(0, 352)), max_size=6)


@given(anchors)
def test_boxes_are_whole_and_apart(points):
    boxes = place_boxes(points, CANVAS, SIZE)
    assert len(boxes) == len(points)
    corners = [(x, box.y, index) for index, box in enumerate(boxes) for x in box.centers]
    for x, y, index in corners:
        assert SIZE.width / 2 <= x <= CANVAS.width - SIZE.width / 2
        assert SIZE.height / 2 <= y <= CANVAS.image_height - SIZE.height / 2
        for other_x, other_y, other in corners:
            assert other == index or abs(x - other_x) >= SIZE.width or abs(y - other_y) >= SIZE.height


@pytest.mark.parametrize("x", [0.0, 3.0, 1150.0])
def test_a_box_at_the_seam_shows_on_both_sides(x):
    [box] = place_boxes([(x, 200.0)], CANVAS, SIZE)
    assert len(box.centers) == 2
    assert min(box.centers) < 30
    assert max(box.centers) > 1120
