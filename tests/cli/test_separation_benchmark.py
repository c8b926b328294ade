import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from avssl_pyro.cli.separation_benchmark import main


def test_every_way_of_separation_is_measured(checkpoint: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["--array", "circle4", "--checkpoint", str(checkpoint), "--scenes", "1"])
    printed = capsys.readouterr().out
    for words in ("delay and sum", "refined: Wiener filter", "one pass: MVDR", "oracle masks", "above delay and sum"):
        assert words in printed


def test_the_command_of_the_page_is_one(checkpoint: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).parents[2] / "docs" / "separation.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"^python scripts/separation_benchmark.py((?:.|\\\n)*?[^\\])$", page, re.MULTILINE)
    words = shlex.split(command.replace("\\\n", " "))
    small = ["--scenes", "1", "--array", "circle4", "--checkpoint", str(checkpoint)]
    main([*words[: words.index("--speech")], *small])
    assert "1 mixtures of two talkers, seed 302" in capsys.readouterr().out


def test_no_scenes_are_refused(refusal: Callable[[Callable[[], int | None]], str]) -> None:
    assert "--scenes is 0" in refusal(lambda: main(["--scenes", "0"]))
