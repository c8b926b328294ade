from pathlib import Path

import cv2
import numpy as np
import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.simulation.people import PeopleFolder
from avssl_pyro.simulation.synthetic.people import ProceduralPerson


def test_a_cutout_is_trimmed_shrunk_and_keeps_its_colors(tmp_path: Path) -> None:
    image_ijc = np.zeros((1000, 600, 4), dtype=np.uint8)
    image_ijc[100:900, 200:400] = (0, 0, 255, 255)  # blue, green, red, alpha: a red person
    cv2.imwrite(str(tmp_path / "person.png"), image_ijc)
    cutout_ijc = PeopleFolder(tmp_path).draw(np.random.default_rng(0))
    assert cutout_ijc.shape == (320, 80, 4)
    assert (cutout_ijc == (255, 0, 0, 255)).all()


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (np.full((50, 30, 3), 90, dtype=np.uint8), "50 x 30 x 3"),
        (np.full((50, 30, 4), 9000, dtype=np.uint16), "uint16"),
        (np.zeros((50, 30, 4), dtype=np.uint8), "transparent"),
        (None, "cannot read"),
    ],
)
def test_a_bad_cutout_is_named(tmp_path: Path, image: np.ndarray | None, reason: str) -> None:
    path = tmp_path / "ghost.png"
    if image is None:
        path.write_bytes(b"no image")
    else:
        cv2.imwrite(str(path), image)
    with pytest.raises(InputError, match=rf"ghost\.png: .*{reason}"):
        PeopleFolder(tmp_path).draw(np.random.default_rng(0))


def test_drawn_people_are_upright_whole_and_varied() -> None:
    rng = np.random.default_rng(3)
    cutouts = [ProceduralPerson().draw(rng) for _ in range(12)]
    for cutout_ijc in cutouts:
        rows, columns = cutout_ijc.shape[:2]
        assert cutout_ijc.dtype == np.uint8
        assert 0.2 < columns / rows < 0.65
        opaque_ij = cutout_ijc[..., 3] > 32
        assert opaque_ij[0].any() and opaque_ij[-1].any()
        # A head is narrower than shoulders.
        assert opaque_ij[round(0.06 * rows)].sum() < 0.75 * opaque_ij[round(0.22 * rows)].sum()
    colors = {tuple(np.median(c[c[..., 3] > 250], axis=0).astype(int)) for c in cutouts}
    assert len(colors) == len(cutouts)
