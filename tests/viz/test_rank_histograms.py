from pathlib import Path

import cv2
import numpy as np
import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.viz.rank_histograms import DIFFERS, FITS, save_rank_histograms


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
