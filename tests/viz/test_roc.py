import cv2
import numpy as np
import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.viz.roc import save_roc

STEPS = np.linspace(0, 1, 11)


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
