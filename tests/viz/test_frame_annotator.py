"""Where things are in an annotated frame, and in which color."""

import numpy as np
import numpy.typing as npt
import pytest

from avssl_pyro.tracking.timeline import IdentifiedSource, Timeline, TimelineFrame
from avssl_pyro.viz.frame_annotator import AnnotationStyle, FrameAnnotator, time_code
from avssl_pyro.viz.palette import OKABE_ITO

ROWS, COLUMNS = 480, 960
GRAY = np.full((ROWS, COLUMNS, 3), 128, dtype=np.uint8)


def source(name: int, azimuth_deg: float, level: float = 0.4, std_deg: float = 2.0) -> IdentifiedSource:
    return IdentifiedSource(name, float(np.deg2rad(azimuth_deg)), float(np.deg2rad(std_deg)), level)


def still(*sources: IdentifiedSource, seconds: float = 10.0) -> Timeline:
    """Sources that stay where they are."""
    return Timeline(tuple(TimelineFrame(0.1 * index, sources) for index in range(round(10 * seconds))), 0.1, 0.5)


def amount(page_ijc: npt.NDArray[np.uint8], color: int) -> npt.NDArray[np.float64]:
    """How much of a palette's color the pixels show that are about as saturated as it, 0 elsewhere."""
    target = 255 * np.array(OKABE_ITO[color])
    return (np.abs(page_ijc.astype(np.float64) - target).max(axis=-1) < 40).astype(np.float64)


def middle(columns: npt.NDArray[np.float64]) -> float:
    """Mean column around the ring, from 0 to 1."""
    angles = 2 * np.pi * (np.arange(len(columns)) + 0.5) / len(columns)
    return float(np.angle((columns * np.exp(1j * angles)).sum()) / (2 * np.pi)) % 1.0


@pytest.mark.parametrize("azimuth_deg", [90.0, -45.0, 0.0, 179.9, -180.0])
def test_line_and_bar_stand_at_the_azimuth(azimuth_deg: float) -> None:
    annotator = FrameAnnotator(ROWS, COLUMNS, still(source(1, azimuth_deg)), AnnotationStyle())
    page_ijc = annotator.draw(GRAY, 5.0)
    for part_ijc in (page_ijc[60 : ROWS - 60], page_ijc[ROWS:]):
        shown = middle(amount(part_ijc, 0).sum(axis=0))
        error = (shown - (180 - azimuth_deg) / 360 + 0.5) % 1 - 0.5
        assert abs(error) * COLUMNS < 1.0


@pytest.mark.parametrize("azimuth_deg", [180.0, -179.95, 179.95])
def test_a_source_at_the_seam_is_at_both_edges(azimuth_deg: float) -> None:
    timeline = still(source(1, azimuth_deg))
    page_ijc = FrameAnnotator(ROWS, COLUMNS, timeline, AnnotationStyle()).draw(GRAY, 5.0)
    for part_ijc in (page_ijc[:60], page_ijc[60:ROWS], page_ijc[ROWS:]):
        columns = amount(part_ijc, 0).sum(axis=0)
        assert columns[:20].sum() > 0
        assert columns[-20:].sum() > 0
        assert columns[80:-80].sum() == 0


def test_bars_rise_with_the_level() -> None:
    heights = []
    for level in (0.2, 0.4, 0.8):
        annotator = FrameAnnotator(ROWS, COLUMNS, still(source(1, 0.0, level)), AnnotationStyle())
        strip_ijc = annotator.draw(GRAY, 5.0)[ROWS:]
        # Four columns beside the middle: inside the bar, outside trail and pointer.
        heights.append(amount(strip_ijc[8:54], 0)[:, COLUMNS // 2 + 3].sum())
    assert heights[1] - heights[0] == pytest.approx(0.2 * 46, abs=1.5)
    assert heights[2] - heights[1] == pytest.approx(0.4 * 46, abs=1.5)


def test_a_source_keeps_its_color_when_louder_ones_come_and_go() -> None:
    quiet = source(4, 60.0, 0.1)
    moments = [
        TimelineFrame(0.1 * index, (quiet,) if index < 20 or index > 40 else (source(7, -90.0, 0.6), quiet))
        for index in range(80)
    ]
    annotator = FrameAnnotator(ROWS, COLUMNS, Timeline(tuple(moments), 0.1, 0.5), AnnotationStyle())
    for time_s in (0.5, 3.0, 7.5):
        line = amount(annotator.draw(GRAY, time_s)[60 : ROWS - 60], 0).sum(axis=0)
        assert middle(line) == pytest.approx(120 / 360, abs=1 / COLUMNS)
    other = amount(annotator.draw(GRAY, 3.0)[60 : ROWS - 60], 1).sum(axis=0)
    assert middle(other) == pytest.approx(270 / 360, abs=1 / COLUMNS)


def test_a_trail_shows_where_a_source_was_and_crosses_the_seam() -> None:
    moments = [TimelineFrame(0.1 * index, (source(1, 150 + 6 * 0.1 * index * 2),)) for index in range(60)]
    annotator = FrameAnnotator(ROWS, COLUMNS, Timeline(tuple(moments), 0.1, 0.5), AnnotationStyle())
    trail_ijc = annotator.draw(GRAY, 5.0)[ROWS + 77 : annotator.height - 3]
    bluish_ij = trail_ijc[..., 2].astype(int) - trail_ijc[..., 0] > 30
    # It went from 150 to 210 degrees: columns 80 down to 0, then 959 down to 880, the newest above.
    rows_of = [np.flatnonzero(bluish_ij[:, column]) for column in (40, 10, 950, 900)]
    assert all(rows.size for rows in rows_of)
    assert rows_of[0].mean() > rows_of[1].mean() > rows_of[2].mean() > rows_of[3].mean()
    assert not bluish_ij[:, 120:860].any()


def test_yaw_and_mirror_move_sources_and_ruler_alike() -> None:
    turned = AnnotationStyle(yaw=float(np.deg2rad(30)))
    mirrored = AnnotationStyle(yaw=float(np.deg2rad(30)), mirror=True)
    for style, share in ((turned, 0.5 - 60 / 360), (mirrored, 0.5 + 60 / 360)):
        page_ijc = FrameAnnotator(ROWS, COLUMNS, still(source(1, 90.0)), style).draw(GRAY, 5.0)
        assert middle(amount(page_ijc[60 : ROWS - 60], 0).sum(axis=0)) == pytest.approx(share, abs=1 / COLUMNS)
    plain = FrameAnnotator(ROWS, COLUMNS, still(), AnnotationStyle()).draw(GRAY, 5.0)[ROWS:]
    rolled = FrameAnnotator(ROWS, COLUMNS, still(), turned).draw(GRAY, 5.0)[ROWS:]
    # Ticks and figures away from the captions and from the figure that meets the edge.
    np.testing.assert_array_equal(np.roll(plain, 80, axis=1)[:76, 160:880], rolled[:76, 160:880])


def test_the_spread_is_shown_only_where_it_means_something() -> None:
    wide, narrow = still(source(1, 0.0, std_deg=5.0)), still(source(1, 0.0, std_deg=1.0))
    widths = []
    for timeline, spread in ((wide, True), (narrow, True), (wide, False)):
        page_ijc = FrameAnnotator(ROWS, COLUMNS, timeline, AnnotationStyle(show_spread=spread)).draw(GRAY, 5.0)
        widths.append(int((page_ijc[200:300] != 128).any(axis=(0, 2)).sum()))
    assert widths[0] == pytest.approx(20 / 360 * COLUMNS, rel=0.15)
    assert widths[1] < widths[2] < widths[0] / 2


@pytest.mark.parametrize(
    ("shape", "size"),
    [((480, 960), 960), ((1440, 2880), 1920), ((88, 288), 1152), ((101, 321), 964), ((720, 1279), 1280)],
)
def test_any_frame_size_gives_even_sides_and_keeps_the_picture(shape: tuple[int, int], size: int) -> None:
    annotator = FrameAnnotator(*shape, still(), AnnotationStyle())
    page_ijc = annotator.draw(np.full((*shape, 3), 90, np.uint8), 1.0)
    assert page_ijc.shape == (annotator.height, annotator.width, 3)
    assert annotator.width == size
    assert annotator.width % 2 == annotator.height % 2 == 0
    assert page_ijc[0, -1].tolist() == [90, 90, 90]
    assert page_ijc[-1].max() < 40


def test_the_time_code_reads_like_a_clock() -> None:
    assert [time_code(t) for t in (0.0, 7.25, 59.999, 60.0, 600.1, 3600.0)] == [
        "0:00.0",
        "0:07.2",
        "0:59.9",
        "1:00.0",
        "10:00.1",
        "1:00:00.0",
    ]
