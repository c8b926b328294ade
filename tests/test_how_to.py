"""The Python of every how-to page runs as it stands, from its first block to its last; the pages stay short."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pyro
import pytest

from avssl_pyro.evaluation.baselines import BASELINES

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs" / "how-to").glob("*.md"))
# What fits on a screen.
MOST_LINES = 45


@pytest.fixture(autouse=True)
def registry() -> Iterator[None]:
    """Baselines that a page registers are gone after it."""
    kept = list(BASELINES)
    yield
    BASELINES[:] = kept


def python_of(page: Path) -> str:
    """All Python blocks of a page, at the lines where they stand in it, so that an error names the page's line."""
    code, inside = [], False
    for line in page.read_text(encoding="utf-8").splitlines():
        fence = line.startswith("```")
        inside = line == "```python" if fence else inside
        code.append("" if fence or not inside else line)
    return "\n".join(code)


@pytest.mark.parametrize("page", [page for page in PAGES if python_of(page).strip()], ids=lambda page: page.stem)
def test_the_python_of_a_page_runs(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pyro.get_param_store().scope():
        exec(compile(python_of(page), str(page), "exec"), {})
    assert re.search(r"\d", capsys.readouterr().out)


def test_a_baseline_of_ones_own_has_a_row_in_the_table(tmp_path: Path) -> None:
    page = ROOT / "docs" / "how-to" / "baseline.md"
    script, command = blocks(page, "python")[0], blocks(page, "sh")[0].split()
    (tmp_path / command[1]).write_text(script)
    # Two processes: a class of the script reaches both.
    words = [*("2" if word == "4" else word for word in command[1:]), "--rounds", "2", "--workers", "2"]
    subprocess.run([sys.executable, *words], cwd=tmp_path, check=True, capture_output=True, timeout=300)
    report = (tmp_path / "runs" / "try" / "report.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (norm-music|delay-and-sum|audio-only refined) \| .*\d", report, re.MULTILINE)
    assert rows[:3] == ["norm-music", "delay-and-sum", "audio-only refined"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_is_a_screen_long(page: Path) -> None:
    assert len(page.read_text(encoding="utf-8").splitlines()) <= MOST_LINES


def blocks(page: Path, language: str) -> list[str]:
    """Every block of code of a language."""
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def commands(page: Path) -> set[str]:
    """Every command of avssl, on one line."""
    lines = re.sub(r"\s*\\\n\s*", " ", "".join(blocks(page, "sh"))).splitlines()
    return {line for line in lines if line.startswith("avssl ")}


def test_commands_are_those_of_the_readme_which_are_run_elsewhere() -> None:
    shown = set.union(*(commands(page) for page in (*PAGES, ROOT / "docs" / "index.md")))
    assert shown
    assert shown <= commands(ROOT / "README.md")
