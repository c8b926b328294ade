from pathlib import Path

import cv2
import numpy as np
import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.simulation.panoramas import PanoramaFolder, to_clip_image
from avssl_pyro.simulation.synthetic.rooms import ProceduralRoom


def brightest_column(image_ijc: np.ndarray) -> int:
    return int(image_ijc[..., 0].sum(axis=0).argmax())


@pytest.mark.parametrize("shape", [(256, 512), (144, 288), (88, 288), (176, 576)])
@pytest.mark.parametrize(("yaw_deg", "column"), [(0.0, 144), (90.0, 72), (-90.0, 216), (179.9, 0), (-135.0, 252)])
def test_what_was_ahead_appears_at_the_azimuth_of_the_turn(shape: tuple[int, int], yaw_deg: float, column: int) -> None:
    panorama_ijc = np.zeros((*shape, 3), dtype=np.uint8)
    panorama_ijc[:, shape[1] // 2] = 255
    image_ijc = to_clip_image(panorama_ijc, np.deg2rad(yaw_deg))
    assert image_ijc.shape == (88, 288, 3)
    assert image_ijc.dtype == np.uint8
    assert (brightest_column(image_ijc) - column + 144) % 288 - 144 in {-1, 0}


def test_a_full_sphere_is_cut_at_55_degrees() -> None:
    elevation_i = 90 - (np.arange(512) + 0.5) * 180 / 512
    panorama_ijc = np.zeros((512, 1024, 3), dtype=np.uint8)
    panorama_ijc[elevation_i > 30] = 200
    panorama_ijc[np.abs(elevation_i) > 56.5] = 99
    image_ijc = to_clip_image(panorama_ijc, 0.3)
    row_elevation_i = 55 - (np.arange(88) + 0.5) * 1.25
    assert not (image_ijc == 99).any()
    assert (image_ijc[row_elevation_i > 31.5] == 200).all()
    assert (image_ijc[row_elevation_i < 28.5] == 0).all()


def test_a_folder_reads_colors_in_order_and_shrinks(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "red.png"), np.full((1000, 2000, 3), (0, 0, 255), dtype=np.uint8))
    panoramas = PanoramaFolder(tmp_path)
    image_ijc = panoramas.draw(np.random.default_rng(0), 1.4)
    assert image_ijc.shape == (576, 1152, 3)
    assert (image_ijc == (255, 0, 0)).all()


@pytest.mark.parametrize(("size", "reason"), [((300, 500), "500 x 300"), ((100, 200), "200 x 100"), (None, "cannot")])
def test_a_bad_panorama_is_named(tmp_path: Path, size: tuple[int, int] | None, reason: str) -> None:
    path = tmp_path / "room.png"
    if size is None:
        path.write_bytes(b"no image")
    else:
        cv2.imwrite(str(path), np.zeros((*size, 3), dtype=np.uint8))
    with pytest.raises(InputError, match=rf"room\.png: .*{reason}"):
        PanoramaFolder(tmp_path).draw(np.random.default_rng(0), 1.4)


def test_a_portrait_is_no_background() -> None:
    with pytest.raises(InputError, match="neither a full sphere"):
        to_clip_image(np.zeros((300, 200, 3), dtype=np.uint8), 0.0)


def test_drawn_walls_meet_the_ceiling_in_perspective() -> None:
    room, rng, camera_m = ProceduralRoom(), np.random.default_rng(0), 1.3
    views_vij = np.stack([room.draw(rng, camera_m).mean(axis=-1) for _ in range(12)])
    assert views_vij.shape[1:] == (176, 576)
    # The edge is there in every room, unlike what hangs on the wall.
    edges_ij = np.median(np.abs(np.diff(views_vij, axis=1)), axis=0)
    for azimuth_deg in (0.0, 20.0, 45.0, -70.0, 135.0):
        azimuth = np.deg2rad(azimuth_deg)
        wall_m = 2.5 / max(abs(np.cos(azimuth)), abs(np.sin(azimuth)))
        row = (55 - np.rad2deg(np.arctan2(3.0 - camera_m, wall_m))) * 176 / 110 - 1
        column = round((180 - azimuth_deg) / 360 * 576)
        upper_half = edges_ij[:70, column - 2 : column + 2].mean(axis=1)
        assert abs(int(upper_half.argmax()) - row) < 2
