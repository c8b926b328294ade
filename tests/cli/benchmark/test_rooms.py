import json
from collections.abc import Callable
from pathlib import Path

import pytest
from measured_room import write_room, write_speech

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.cli.benchmark.rooms import rooms
from avssl_pyro.cli.localize import main as localize

AZIMUTHS_DEG = (0, 45, 90, 135, 180, -135, -90, -45)
BASELINES = {"srp-phat", "music", "norm-music"}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("measured")
    write_room(folder / "room", PRESETS["circle4"], AZIMUTHS_DEG)
    PRESETS["circle4"].save(folder / "room" / "array.yaml")
    write_speech(folder / "speech")
    return ["--responses", str(folder / "room"), "--speech", str(folder / "speech"), "--workers", "1"]


def test_every_kind_of_clip_has_a_table_beside_the_baselines(
    folders: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, clips = tmp_path / "new" / "rooms.json", tmp_path / "clips"
    command = [*folders, "--num-clips", "3", "2", "3", "--seed", "5"]
    rooms([*command, "--out", str(out), "--clips", str(clips)])
    printed = capsys.readouterr().out
    assert all(title in printed for title in ("1 talker: 3 clips", "2 talkers: 2 clips", "nobody: 3 clips"))
    assert "an advantage that the model does not" in " ".join(printed.split())
    kept = json.loads(out.read_text())
    assert set(kept["tuned_on_these_clips"]) == BASELINES
    scores = {row["method"]: row for row in kept["tables"]["1 talker"]}
    assert scores["norm-music, tuned"]["hits"] == scores["audio-only model"]["hits"] == 3
    assert scores["audio-only model"]["error_deg"] < 5
    assert all(row["false"]["silence"] == 0 for row in kept["tables"]["nobody"])
    again = tmp_path / "again.json"
    rooms([*command, "--out", str(again)])
    assert again.read_bytes() == out.read_bytes()
    capsys.readouterr()
    # The clips are in a form that the command for clips takes.
    localize(["--clips", str(clips / "clips.csv"), "--array", str(clips / "array.yaml"), "--rounds", "2"])
    assert len(capsys.readouterr().out.splitlines()) == 8


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--num-clips", "0", "0", "3"], "--num-clips 0 0 3: give numbers of at least 0, and at least one clip with"),
        (["--num-clips", "1", "-1", "3"], "--num-clips 1 -1 3: give numbers"),
        (["--array", "circle6"], "4 channel(s), but array 'circle6' has 6 microphones"),
        (["--responses", "nowhere"], "nowhere: no such folder of room responses."),
        (["--speech", "nowhere"], "nowhere: no such folder; give a folder of speech files"),
        (["--checkpoint", "nowhere.safetensors"], "nowhere.safetensors"),
        (["--seed", "-1"], "--seed is -1; give a number of at least 0."),
    ],
)
def test_what_cannot_be_compared_is_refused(
    options: list[str],
    says: str,
    folders: list[str],
    tmp_path: Path,
    refusal: Callable[[Callable[[], int | None]], str],
) -> None:
    small = ["--num-clips", "1", "0", "0", "--out", str(tmp_path / "rooms.json")]
    assert says in refusal(lambda: rooms([*folders, *small, *options]))
    assert not (tmp_path / "rooms.json").exists()


def test_a_file_in_place_of_the_clips_folder_is_refused(
    folders: list[str], tmp_path: Path, refusal: Callable[[Callable[[], int | None]], str]
) -> None:
    (tmp_path / "file").write_text("")
    assert "is a file; name a folder." in refusal(lambda: rooms([*folders, "--clips", str(tmp_path / "file")]))
