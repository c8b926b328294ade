import json
from pathlib import Path

import numpy as np
import pytest

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.benchmarks.rooms.clips import ONE_TALKER, PINK, SILENCE, TWO_TALKERS, WHITE, RoomClip
from avssl_pyro.benchmarks.rooms.scores import MODEL, Estimates, RoomsResult, choose_array, run_rooms
from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.peaks import PeakSetting
from avssl_pyro.localization.posterior import LocalizedSource


def clip(kind: str, *azimuths_deg: float) -> RoomClip:
    audio_mn = np.zeros((4, 16_000), np.float32)
    return RoomClip(Clip.from_audio(kind, audio_mn), kind, np.deg2rad(np.array(azimuths_deg)))


def estimates(*degrees: list[float], std_deg: float) -> Estimates:
    sources = [
        [LocalizedSource(np.deg2rad(azimuth), np.deg2rad(std_deg), 0.5, 0.1, 0.4, k) for k, azimuth in enumerate(each)]
        for each in degrees
    ]
    return Estimates([np.deg2rad(np.array(each)) for each in degrees], sources)


CLIPS = [clip(ONE_TALKER, 0), clip(ONE_TALKER, 180), clip(TWO_TALKERS, 0, 90), clip(WHITE), clip(PINK), clip(SILENCE)]
# Errors of 3 and 15 degrees with one talker; one of two and a false one; two false in white noise.
FOUND = ([3.0], [-165.0], [1.0, 60.0], [10.0, 20.0], [], [])
RESULT = RoomsResult(
    "circle4",
    CLIPS,
    {
        MODEL: estimates(*FOUND, std_deg=4.0),
        "music": Estimates([np.array([])] * 6, setting=PeakSetting(0.5, 2)),
    },
)


def test_hits_false_counts_errors_and_coverage_are_counted_by_kind() -> None:
    one, two, nobody = RESULT.tables()
    assert [table.title for table in (one, two, nobody)] == [
        "1 talker: 2 clips",
        "2 talkers: 1 clip",
        "nobody: 3 clips",
    ]
    # 3 degrees are within 4; 15 are a miss, but within the gate of coverage and beyond two deviations.
    assert one.texts() == {
        MODEL: ["1 of 2", "1", "2 of 2", "3.0°", "0.50", "0.50"],
        "music, tuned": ["0 of 2", "0", "0 of 2", "–", "–", "–"],
    }
    assert two.texts()[MODEL] == ["1 of 2", "1", "1 of 1", "1.0°", "1.00", "1.00"]
    assert nobody.texts() == {MODEL: ["2", "0", "0", "2 of 3"], "music, tuned": ["0", "0", "0", "3 of 3"]}
    assert (one.notes, two.notes) == ((), ())
    assert "of these very tables" in nobody.notes[1] and "music 0.5 (up to 2)" in nobody.notes[1]


def test_figures_and_estimates_are_kept(tmp_path: Path) -> None:
    RESULT.write(tmp_path / "rooms.json", seed=7)
    kept = json.loads((tmp_path / "rooms.json").read_text())
    assert (kept["format"], kept["seed"], kept["array"]) == ("avssl-rooms/1", 7, "circle4")
    assert kept["tuned_on_these_clips"] == {"music": {"threshold": 0.5, "max_peaks": 2}}
    model, music = kept["tables"]["1 talker"]
    assert (model["hits"], model["false"], model["error_deg"]) == (1, 1, pytest.approx(3.0))
    assert music["within_one"] is None
    assert kept["tables"]["nobody"][0]["false"] == {WHITE: 2, PINK: 0, SILENCE: 0}
    assert [each["estimates_deg"][MODEL] for each in kept["clips"]] == [list(each) for each in FOUND]
    assert kept["clips"][2]["stated_deg"][MODEL] == [4.0, 4.0]


def test_kinds_without_clips_have_no_table() -> None:
    short = RoomsResult("circle4", CLIPS[:2], {MODEL: estimates([0.0], [180.0], std_deg=1.0)})
    (table,) = short.tables()
    assert table.texts()[MODEL][0] == "2 of 2"


def test_thresholds_need_a_talker() -> None:
    with pytest.raises(InputError, match="no clip has a talker"):
        run_rooms(CLIPS[3:], PRESETS["circle4"])


def test_the_only_array_file_of_the_folder_is_the_array(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"give --array, .*: .* has no YAML file of one\."):
        choose_array(None, tmp_path)
    PRESETS["circle4"].save(tmp_path / "ours.yaml")
    assert choose_array(None, tmp_path) == PRESETS["circle4"]
    assert choose_array("circle6", tmp_path) == PRESETS["circle6"]
    PRESETS["circle6"].save(tmp_path / "other.yml")
    with pytest.raises(InputError, match=r"has 2 \(other\.yml, ours\.yaml\)"):
        choose_array(None, tmp_path)
    with pytest.raises(InputError, match="no such folder of room responses"):
        choose_array(None, tmp_path / "gone")
