import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.errors import InputError
from avssl_pyro.io.dcase import DcaseRow, azimuths_by_frame, labels_between, merge_azimuths, read_dcase, write_dcase

TENTHS = st.integers(-1800, 1800).map(lambda tenth: tenth / 10)
ROWS = st.builds(
    DcaseRow,
    frame=st.integers(0, 10_000),
    class_index=st.integers(0, 12),
    source=st.integers(0, 5),
    azimuth_deg=TENTHS,
    elevation_deg=st.integers(-900, 900).map(lambda tenth: tenth / 10),
    distance_cm=st.none(),
)


@given(rows=st.lists(ROWS, max_size=8), distance_cm=st.none() | st.integers(1, 2000).map(float))
def test_what_is_written_comes_back(
    tmp_path_factory: pytest.TempPathFactory, rows: list[DcaseRow], distance_cm: float | None
) -> None:
    rows = [
        DcaseRow(row.frame, row.class_index, row.source, row.azimuth_deg, row.elevation_deg, distance_cm)
        for row in rows
    ]
    path = tmp_path_factory.mktemp("dcase") / "labels.csv"
    write_dcase(path, rows)
    assert list(read_dcase(path)) == sorted(rows, key=lambda row: (row.frame, row.class_index, row.source))
    assert all(line.count(",") == (4 if distance_cm is None else 5) for line in path.read_text().splitlines())


def test_all_four_forms_say_the_same(tmp_path: Path) -> None:
    x, y, z = math.cos(0.5) * math.cos(2.0), math.cos(0.5) * math.sin(2.0), math.sin(0.5)
    azimuth, elevation = math.degrees(2.0), math.degrees(0.5)
    lines = {
        f"7,3,{azimuth},{elevation}": DcaseRow(7, 3, 0, azimuth, elevation),
        f"7,3,1,{azimuth},{elevation}": DcaseRow(7, 3, 1, azimuth, elevation),
        f"7,3,1,{azimuth},{elevation},220": DcaseRow(7, 3, 1, azimuth, elevation, 220.0),
        f"7,3,1,{x},{y},{z},220": DcaseRow(7, 3, 1, azimuth, elevation, 220.0),
    }
    path = tmp_path / "labels.csv"
    path.write_text("\r\n".join(lines) + "\r\n")
    for row, expected in zip(read_dcase(path), lines.values(), strict=True):
        assert (row.frame, row.class_index, row.source) == (7, 3, expected.source)
        assert (row.azimuth_deg, row.elevation_deg) == pytest.approx((azimuth, elevation))
        assert row.distance_cm == expected.distance_cm


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("1,2,3", "line 2: 3 columns"),
        ("1,speech,0,30,0", "something else than numbers"),
        ("1.5,0,0,30,0", "does not begin with a frame"),
        ("1,0,0,nan,0", "not finite"),
        ("1,0,0,30,95", "no direction"),
    ],
)
def test_bad_lines_are_named(tmp_path: Path, line: str, words: str) -> None:
    path = tmp_path / "labels.csv"
    path.write_text(f"0,0,0,10,0\n{line}\n")
    with pytest.raises(InputError, match=words):
        read_dcase(path)


def test_neighbours_are_merged_across_the_seam() -> None:
    merged = np.rad2deg(merge_azimuths(np.deg2rad([179.0, -178.0, 10.0, 13.0, 40.0]).tolist()))
    assert sorted(merged) == pytest.approx([-179.5, 11.5, 40.0])
    rows = [DcaseRow(0, 0, 0, 10.0), DcaseRow(0, 5, 0, 12.0), DcaseRow(4, 0, 1, 90.0)]
    frames = azimuths_by_frame(rows)
    assert {frame: np.rad2deg(azimuths).tolist() for frame, azimuths in frames.items()} == {
        0: pytest.approx([11.0]),
        4: pytest.approx([90.0]),
    }


def test_a_clip_is_labelled_with_who_sounds_half_of_it() -> None:
    rows = [DcaseRow(frame, 0, 0, 90.0 + frame - 14.5) for frame in range(10, 20)]
    rows += [DcaseRow(frame, 1, 0, -90.0) for frame in range(16, 40)]
    assert np.rad2deg(labels_between(rows, 1.0).talker_azimuths) == pytest.approx([90.0])
    assert np.rad2deg(labels_between(rows, 2.0).talker_azimuths) == pytest.approx([-90.0])
    assert labels_between(rows, 4.0).talker_azimuths == ()
