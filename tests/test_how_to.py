"""The Python of every how-to page runs as it stands, from its first block to its last; the pages stay short."""

import re
from pathlib import Path

import pyro
import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs" / "how-to").glob("*.md"))
# What fits on a screen.
MOST_LINES = 40


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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_is_a_screen_long(page: Path) -> None:
    assert len(page.read_text(encoding="utf-8").splitlines()) <= MOST_LINES


def commands(page: Path) -> set[str]:
    """Every command of avssl, on one line."""
    blocks = re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    lines = re.sub(r"\s*\\\n\s*", " ", "".join(blocks)).splitlines()
    return {line for line in lines if line.startswith("avssl ")}


def test_commands_are_those_of_the_readme_which_are_run_elsewhere() -> None:
    shown = set.union(*(commands(page) for page in (*PAGES, ROOT / "docs" / "index.md")))
    assert shown
    assert shown <= commands(ROOT / "README.md")
