import cv2
import numpy as np
import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.viz.curves import running_mean, save_curves


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
