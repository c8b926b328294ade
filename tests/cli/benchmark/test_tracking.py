import re
import shlex
from pathlib import Path

import pytest

from avssl_pyro.cli.benchmark.tracking import tracking
from avssl_pyro.errors import InputError


def test_prints_every_way_to_link_windows(capsys: pytest.CaptureFixture[str]) -> None:
    tracking(["--num-recordings", "1", "--talkers.seconds", "5"])
    printed = capsys.readouterr().out
    for way in ("windows alone", "linked to nearest", "tracked live, lag 3", "tracked "):
        assert way in printed


def test_commands_and_example_of_the_page_run(capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).parents[3] / "docs" / "tracking.md").read_text(encoding="utf-8")
    commands = re.findall(r"^avssl benchmark tracking(.*)$", page, re.MULTILINE)
    assert len(commands) >= 2
    for command in commands:
        tracking([*shlex.split(command), "--num-recordings", "1", "--talkers.seconds", "2"])
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    exec(compile(example, "docs/tracking.md", "exec"), {})
    assert "TrackedSource(track_id=0" in capsys.readouterr().out


def test_localizes_what_is_heard(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--talkers.seconds", "1.5", "--talkers.step-s", "0.25", "--talkers.num-talkers", "1", "1"]
    tracking(["--rendered", "--array", "circle4", "--num-recordings", "1", *options])
    assert "1 recordings of 1.5 s" in capsys.readouterr().out


def test_nothing_to_track_is_refused() -> None:
    with pytest.raises(InputError, match="--num-recordings 0"):
        tracking(["--num-recordings", "0"])
