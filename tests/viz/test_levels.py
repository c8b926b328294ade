import numpy as np
import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.viz.levels import draw_levels


def test_every_draw_is_a_column_stacked_to_one():
    level_sk = np.array([[0.2, 0.3, 0.5], [1.0, 0.0, 0.0]])
    figure = draw_levels({"prior": level_sk, "posterior": level_sk[:1]})
    first, second = figure.axes
    assert [ax.get_title() for ax in figure.axes] == ["prior", "posterior"]
    tops = {}
    for bar in first.patches:
        column = round(bar.get_x() + bar.get_width() / 2)
        assert bar.get_y() == pytest.approx(tops.get(column, 0.0))
        tops[column] = bar.get_y() + bar.get_height()
    assert tops == pytest.approx({0: 1.0, 1: 1.0})
    assert len(second.patches) == 3


def test_what_cannot_be_drawn_is_told():
    with pytest.raises(InputError, match="no panel"):
        draw_levels({})
    with pytest.raises(InputError, match=r"'prior' has draws of shape \(3,\)"):
        draw_levels({"prior": np.ones(3)})
