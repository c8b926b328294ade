"""Pages of docs/ can be read without the site; that every page is in it, and its links there, the build checks."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
# Made by the build.
MADE = DOCS / "api"
PAGES = sorted(DOCS.rglob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_links_lead_to_files_of_the_repository(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", text):
        target = (page.parent / link).resolve()
        assert target.exists(), link
        assert not target.is_relative_to(MADE), f"{link} is not in the repository"


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


# Souden, Benesty and Affes 2010; Le Roux et al. 2019; Okabe and Ito (2008); SRP-PHAT (DiBiase 2000).
WORK = re.compile(r"\b([A-Z][a-z]+[A-Za-z]+)(?:(?:, | and )[A-Z]\w+)*(?: et al\.)? \(?((?:19|20)\d\d)\b(?!-)")


def test_every_cited_work_is_in_the_bibliography() -> None:
    keys = re.findall(r"^@\w+\{(\w+),", (DOCS / "references.bib").read_text(encoding="utf-8"), re.MULTILINE)
    sources = [path for folder in ("avssl_pyro", "models", "guides") for path in (ROOT / folder).rglob("*.py")]
    cited = set()
    for path in (*sources, *PAGES, ROOT / "README.md"):
        words = re.sub(r"[\s#]+", " ", path.read_text(encoding="utf-8"))
        cited |= {f"{name.lower()}{year}" for name, year in WORK.findall(words)}
    assert len(cited) > 15
    assert not {work for work in cited if not any(key.endswith(work) for key in keys)}


def test_every_module_but_the_commands_has_a_page() -> None:
    listed = set(re.findall(r"^   (avssl_pyro\.\w+)$", (ROOT / "docs" / "api.rst").read_text(), re.MULTILINE))
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    packages = {name for name in setuptools["packages"] if name.count(".") == 1}
    modules = {f"avssl_pyro.{path.stem}" for path in (ROOT / "avssl_pyro").glob("[!_]*.py")}
    # Packages are listed with all that is in them; commands explain themselves by --help.
    assert listed == packages - {"avssl_pyro.cli"} | modules
