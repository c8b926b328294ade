"""Pages of docs/ can be read without the site; that every page is in it, and its links there, the build checks."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
# Made by the build.
MADE = (DOCS / "api", DOCS / "notebooks")
PAGES = [page for page in sorted(DOCS.rglob("*.md")) if not page.is_relative_to(MADE[1])]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_links_lead_to_files_of_the_repository(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", text):
        target = (page.parent / link).resolve()
        assert target.exists(), link
        assert not any(target.is_relative_to(made) for made in MADE), f"{link} is not in the repository"


def test_equations_of_the_method_have_the_papers_numbers() -> None:
    tags = re.findall(r"\\tag\{(\d+)\}", (DOCS / "method.md").read_text(encoding="utf-8"))
    # The paper numbers nineteen equations.
    assert [int(tag) for tag in tags] == list(range(1, 20))


# Eq. (4), Eqs. (15)-(19), Eqs. (5, 6) and, within brackets, Eqs. 15, 16; not those of other papers, named with a year.
CITATION = re.compile(r"(?<!\d{4}, )\bEqs?\. \(?(\d+)(?:[-(), ]+(\d+))*")


def test_the_library_cites_equations_of_the_paper() -> None:
    cited = {
        int(number)
        for folder in ("avssl_pyro", "models", "guides")
        for path in (ROOT / folder).rglob("*.py")
        for match in CITATION.finditer(path.read_text(encoding="utf-8"))
        for number in re.findall(r"\d+", match[0])
    }
    assert {1, 4, 10, 15, 16, 18, 19} <= cited <= set(range(1, 20))
