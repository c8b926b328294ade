import json
from collections.abc import Callable
from pathlib import Path

import pytest
from fake_simulator import FakeSimulator, fake_plan

from avssl_pyro.datasets.generation import GenerationPlan, generate
from avssl_pyro.datasets.shards import verify_dataset


def test_sound_scenes_have_no_problems(make_scenes: Callable[..., GenerationPlan]) -> None:
    assert verify_dataset(make_scenes().folder) == []


def test_each_bad_shard_is_named(make_scenes: Callable[..., GenerationPlan]) -> None:
    folder = make_scenes(num_scenes=20).folder
    truncated, altered, missing, grown = (folder / f"scenes-{number:06d}.tar" for number in range(4))
    truncated.write_bytes(truncated.read_bytes()[:-1])
    content = bytearray(altered.read_bytes())
    content[len(content) // 2] ^= 1
    altered.write_bytes(content)
    missing.unlink()
    grown.write_bytes(grown.read_bytes() + b"x")
    (folder / "scenes-000099.tar").touch()
    problems = verify_dataset(folder)
    assert len(problems) == 5
    for problem, words in zip(
        problems,
        [
            "000000.tar is truncated",
            "000001.tar is altered",
            "000002.tar is missing",
            "000003.tar is altered",
            "000099",
        ],
        strict=True,
    ):
        assert words in problem


def test_unfinished_scenes_are_not_sound(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No space"):
        generate(fake_plan(tmp_path, 10, FakeSimulator(disk_full_at=5)), workers=1, progress=False)
    assert "no manifest.json" in verify_dataset(tmp_path)[0]
    assert "no such folder" in verify_dataset(tmp_path / "nowhere")[0]


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("format", "avssl-scenes/9", "avssl-scenes/9"),
        ("shards", None, "'shards' is missing"),
        ("shards", [], "do not add up"),
        ("shards", [{"name": "../x"}], "a shard entry is damaged"),
        ("shards", [{"name": "../x", "num_scenes": 1, "num_bytes": 1, "sha256": ""}], "outside the folder"),
        ("seed", "x", "damaged"),
        ("num_scenes", 9, "do not add up"),
    ],
)
def test_a_damaged_manifest_is_told_in_a_sentence(
    make_scenes: Callable[..., GenerationPlan], field: str, value: object, words: str
) -> None:
    path = make_scenes().folder / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {field: value}))
    (problem,) = verify_dataset(path.parent)
    assert words in problem
    assert str(path) in problem


def test_a_manifest_cut_short_is_told_in_a_sentence(make_scenes: Callable[..., GenerationPlan]) -> None:
    path = make_scenes().folder / "manifest.json"
    path.write_text(path.read_text()[:100])
    (problem,) = verify_dataset(path.parent)
    assert "not valid JSON" in problem
