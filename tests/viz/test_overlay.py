import cv2
import numpy as np
import pytest

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource
from avssl_pyro.viz.overlay import draw_overlay, save_overlay
from avssl_pyro.viz.palette import OKABE_ITO

GRID = DirectionGrid()
GRAY = np.full((88, 288, 3), 128, dtype=np.uint8)


def scene(azimuths_deg, levels, with_maps=True):
    """One class per azimuth with an activation there at mid height, and its sources (those with a level)."""
    num_classes = len(azimuths_deg)
    column_deg = 180 - 360 * (np.arange(144) + 0.5) / 144
    row = np.arange(44)[:, None]
    maps = np.stack([40 * (np.cos(np.deg2rad(column_deg - a)) - 1)[None] - ((row - 22) / 8) ** 2 for a in azimuths_deg])
    weights_kd = np.stack([np.exp(60 * (np.cos(GRID.azimuths - np.deg2rad(a)) - 1)) for a in azimuths_deg])
    weights_kd /= weights_kd.sum(axis=-1, keepdims=True)
    posterior = ClipPosterior(
        weights_kd,
        np.array(levels),
        np.full(num_classes, 0.02),
        np.full(num_classes, 0.05),
        maps.astype(np.float32) if with_maps else None,
    )
    sources = tuple(
        LocalizedSource(float(np.deg2rad(a)), 0.05, level, 0.02, level, k)
        for k, (a, level) in enumerate(zip(azimuths_deg, levels, strict=True))
        if level > 0
    )
    return posterior, sources


def amount(picture_ijc, k):
    """How much of a class's color each column of the (gray) picture shows, ruler left out."""
    image = picture_ijc[:352].astype(np.float64)
    tint = np.array(OKABE_ITO[k])
    tint = tint - tint.mean()
    return np.clip((image - image.mean(axis=-1, keepdims=True)) @ tint, 0, None).sum(axis=0)


@pytest.mark.parametrize("with_maps", [True, False])
@pytest.mark.parametrize("azimuth_deg", [90.0, -45.0, 0.0])
def test_color_gathers_at_the_azimuth(azimuth_deg, with_maps):
    posterior, sources = scene([azimuth_deg], [0.4], with_maps)
    shown = amount(draw_overlay(GRAY, posterior, sources, GRID), 0)
    center = float((shown * np.arange(1152)).sum() / shown.sum())
    assert center == pytest.approx((180 - azimuth_deg) / 360 * 1152, abs=6)


def test_left_of_the_camera_is_in_the_left_quarter():
    posterior, sources = scene([90.0], [0.4])
    shown = amount(draw_overlay(GRAY, posterior, sources, GRID), 0)
    assert shown[144:432].sum() > 0.95 * shown.sum()


@pytest.mark.parametrize("azimuth_deg", [180.0, -180.0, 179.0, -179.0])
def test_a_source_at_the_seam_shows_on_both_sides(azimuth_deg):
    posterior, sources = scene([azimuth_deg], [0.4])
    shown = amount(draw_overlay(GRAY, posterior, sources, GRID), 0)
    left, right = shown[:100].sum(), shown[-100:].sum()
    assert 0.5 < left / right < 2
    assert left + right > 0.95 * shown.sum()


def test_turning_the_scene_turns_the_picture():
    # Half a turn brings both sources off and onto the seam; all but boxes, moved inside at the seam, must agree.
    first = draw_overlay(GRAY, *scene([0.0, 90.0], [0.4, 0.3]), GRID)[:352].astype(int)
    second = draw_overlay(GRAY, *scene([180.0, -90.0], [0.4, 0.3]), GRID)[:352].astype(int)
    different = np.abs(np.roll(first, 576, axis=1) - second).max(axis=-1) > 40
    assert different.mean() < 0.015


def test_a_silent_class_is_fainter_than_a_source_and_a_diffuse_one_is_not_shown():
    posterior, sources = scene([60.0, -60.0], [0.5, 0.4])
    diffuse_kd = np.vstack([posterior.direction_weights_kd, np.full((1, 72), 1 / 72)])
    maps = np.concatenate([posterior.activations_kij, np.zeros((1, 44, 144), np.float32)])
    with_noise = ClipPosterior(diffuse_kd, np.array([0.5, 0.0, 0.5]), np.full(3, 0.02), np.full(3, 0.05), maps)
    speaking = amount(draw_overlay(GRAY, with_noise, sources, GRID), 1)[684:852].sum()
    picture = draw_overlay(GRAY, with_noise, sources[:1], GRID)
    assert 0.1 * speaking < amount(picture, 1)[684:852].sum() < 0.6 * speaking
    # Away from both, the muted gray photograph shines through unchanged.
    assert np.ptp(picture[20:330, 530:620].reshape(-1, 3), axis=0).max() <= 2


def test_a_class_merged_into_a_source_is_not_shown_as_rejected():
    # A chain of merged classes may reach farther than rejected ones are kept away.
    posterior, sources = scene([60.0, 40.0], [0.5, 0.4])
    merged = LocalizedSource(sources[0].azimuth, 0.05, 0.9, 0.02, 0.9, 0, (1,))
    picture = draw_overlay(GRAY, posterior, [merged], GRID)
    alone = scene([60.0], [0.9])
    np.testing.assert_array_equal(picture, draw_overlay(GRAY, *alone, GRID))


def test_truth_is_drawn_only_when_given():
    posterior, sources = scene([60.0], [0.5])
    plain = draw_overlay(GRAY, posterior, sources, GRID)
    marked = draw_overlay(GRAY, posterior, sources, GRID, truth=np.deg2rad([-60.0]))
    columns = np.flatnonzero((plain != marked).any(axis=(0, 2)))
    assert columns.mean() == pytest.approx(240 / 360 * 1152, abs=2)
    assert np.ptp(columns) < 30


@pytest.mark.parametrize(
    ("shape", "width"), [((88, 288), 1152), ((512, 1024), 2048), ((100, 1300), 1300), ((7, 11), 1155)]
)
def test_any_image_size_works(shape, width):
    posterior, sources = scene([175.0, 170.0], [0.5, 0.4])
    picture = draw_overlay(np.zeros((*shape, 3), np.uint8), posterior, sources, GRID)
    assert picture.dtype == np.uint8
    assert picture.shape[1:] == (width, 3)
    assert picture.shape[0] > shape[0] * (width // shape[1])


def test_no_source_and_more_classes_than_colors_work():
    posterior, _ = scene(np.linspace(-170, 170, 9), [0.0] * 9)
    assert draw_overlay(GRAY, posterior, (), GRID).shape[1] == 1152


def test_the_file_holds_the_picture(tmp_path):
    posterior, sources = scene([60.0], [0.5])
    save_overlay(tmp_path / "new" / "out.png", GRAY, posterior, sources, GRID)
    read = cv2.cvtColor(cv2.imread(str(tmp_path / "new" / "out.png")), cv2.COLOR_BGR2RGB)
    np.testing.assert_array_equal(read, draw_overlay(GRAY, posterior, sources, GRID))


def test_a_full_disk_leaves_no_file(tmp_path, full_disk):
    posterior, sources = scene([60.0], [0.5])
    with pytest.raises(OSError, match="No space"):
        save_overlay(tmp_path / "out.png", GRAY, posterior, sources, GRID)
    assert list(tmp_path.iterdir()) == []
