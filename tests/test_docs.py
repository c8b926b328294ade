"""Pages of docs/ can be read without the site; that every page is in it, and its links there, the build checks."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parent.parent / "docs"
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
