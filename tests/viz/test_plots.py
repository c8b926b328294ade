from pathlib import Path

import cv2
import numpy as np
import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.viz.plots import (
    DIFFERS,
    FITS,
    draw_levels,
    running_mean,
    save_curves,
    save_rank_histograms,
    save_roc,
)

STEPS = np.linspace(0, 1, 11)


def test_the_running_mean_is_unbiased_at_the_ends_and_skips_gaps():
    values = np.array([1.0, 3.0, np.nan, 5.0, np.inf, 7.0])
    assert running_mean(values, 3).tolist() == [2.0, 2.0, 4.0, 5.0, 6.0, 7.0]
    assert np.isnan(running_mean(np.full(3, np.nan), 3)).all()
    np.testing.assert_allclose(running_mean(np.full(50, 2.5), 9), 2.5)


def test_curves_of_any_shape_are_drawn(tmp_path):
    steps = [0, 10, 20, 30]
    series = {
        "loss": [4.0, 3.0, 2.0, 1.0],
        "constant": [0.0] * 4,
        "gaps": [float("nan"), 1.0, float("inf"), 2.0],
        "never": [float("nan")] * 4,
    }
    save_curves(tmp_path / "run" / "curves.png", steps, series)
    picture = cv2.imread(str(tmp_path / "run" / "curves.png"))
    assert picture.shape[1] > picture.shape[0] > 300
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["curves.png"]


@pytest.mark.parametrize("steps", [[], [5]])
def test_a_run_that_has_barely_begun_can_be_drawn(tmp_path, steps):
    save_curves(tmp_path / "curves.png", steps, {"loss": [1.0] * len(steps)})
    assert (tmp_path / "curves.png").stat().st_size > 1000


def test_lengths_must_agree(tmp_path):
    with pytest.raises(InputError, match="'beta' has 1 values for 2 steps"):
        save_curves(tmp_path / "curves.png", [0, 1], {"loss": [1.0, 2.0], "beta": [1.0]})
    with pytest.raises(InputError, match="no series"):
        save_curves(tmp_path / "curves.png", [], {})
    assert list(tmp_path.iterdir()) == []


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


def ink(path):
    """Share of pixels that are neither white nor grey."""
    image_ijc = cv2.imread(str(path)).astype(int)
    return float((np.ptp(image_ijc, axis=-1) > 60).mean())


def test_a_panel_per_array_and_a_line_per_method(tmp_path):
    curves = {"amortized, area 0.700": (STEPS, STEPS**0.5), "refined, area 0.900": (STEPS, STEPS**0.1)}
    save_roc(tmp_path / "new" / "two.png", {"M = 2": curves, "M = 4": curves})
    save_roc(tmp_path / "one.png", {"M = 2": curves})
    save_roc(tmp_path / "empty.png", {"M = 2": {}})
    two, one = (cv2.imread(str(tmp_path / name)) for name in ("new/two.png", "one.png"))
    assert two.shape[0] == one.shape[0]
    assert two.shape[1] == pytest.approx(2 * one.shape[1], abs=2)
    assert ink(tmp_path / "one.png") > 0.005
    assert ink(tmp_path / "empty.png") == 0


def test_no_panel_is_told(tmp_path):
    with pytest.raises(InputError, match="no panel"):
        save_roc(tmp_path / "roc.png", {})


def share_of(path: Path, color: str) -> float:
    """The share of the picture's pixels in one colour."""
    image = cv2.imread(str(path))[..., ::-1]
    rgb = [int(color[i : i + 2], 16) for i in (1, 3, 5)]
    return float((image == rgb).all(-1).mean())


def test_histograms_that_differ_from_uniform_have_a_colour_of_their_own(tmp_path: Path) -> None:
    counts = {"refined": {"level": np.full(10, 20), "scale": np.array([60, 0, 0, 0, 40, 40, 0, 0, 0, 60])}}
    for p_value, present, absent in ((0.5, FITS, DIFFERS), (1e-6, DIFFERS, FITS)):
        path = tmp_path / f"{p_value}.png"
        save_rank_histograms(path, counts, {"refined": {"level": p_value, "scale": p_value}})
        assert share_of(path, present) > 0.02
        assert share_of(path, absent) == 0


def test_nothing_to_draw_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no posterior"):
        save_rank_histograms(tmp_path / "none.png", {}, {})
