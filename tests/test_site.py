"""What the documentation site makes of pages, notebooks and docstrings written to be read in the repository."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sphinx", reason="the documentation's tools are not installed")

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PRIORS = "avssl_pyro.models.priors"


@pytest.fixture(autouse=True)
def _extensions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(DOCS / "_extensions")


@pytest.mark.parametrize(
    ("folder", "written", "shown"),
    [
        (DOCS, "[`SparseDirichlet`](../models/priors.py)", f"{{py:obj}}`SparseDirichlet <{PRIORS}.SparseDirichlet>`"),
        (DOCS, "[priors](../models/priors.py)", f"{{py:mod}}`priors <{PRIORS}>`"),
        (DOCS, f"[`{PRIORS}`](../models/priors.py)", f"{{py:mod}}`{PRIORS} <{PRIORS}>`"),
        (DOCS, "[a tour](../notebooks/1-tour.ipynb)", "[a tour](/notebooks/1-tour.ipynb)"),
        (DOCS, "[card](../avssl_pyro/weights/MODEL_CARD.md)", "[card](/model-card.md)"),
        (DOCS, "[API](../avssl_pyro)", "[API](/api/index.rst)"),
        (DOCS, "[doctor](doctor.md)", "[doctor](doctor.md)"),
        (DOCS / "how-to", "[arrays](../arrays.md)", "[arrays](/arrays.md)"),
        (ROOT / "notebooks", "[method](../docs/method.md#the-model)", "[method](/method.md#the-model)"),
        (ROOT / "notebooks", "[priors](2-priors.ipynb)", "[priors](2-priors.ipynb)"),
    ],
)
def test_links_of_the_repository_lead_to_pages(folder: Path, written: str, shown: str) -> None:
    from source_links import rewrite

    assert rewrite(f"See {written}.", folder, {ROOT / "models" / "priors.py": PRIORS}) == f"See {shown}."


def test_every_module_has_a_page() -> None:
    from api_pages import packages, pages

    files = {path for folder in ("avssl_pyro", "models", "guides") for path in (ROOT / folder).rglob("*.py")}
    assert {module.path for package in packages() for module in (package, *package.inside)} == files
    assert f".. automodule:: {PRIORS}\n" in pages()[PRIORS]
    assert f"   {PRIORS}\n" in pages()["avssl_pyro.models"]
    assert "   avssl_pyro.models\n" in pages()["index"]


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        ("of Eq. (13).", "of Eq. :eq:`eq-13`."),
        ("Eqs. (9)-(11), masks", "Eqs. :eq:`eq-9`-:eq:`eq-11`, masks"),
        ("masks (Eqs. 5, 6), for", "masks (Eqs. :eq:`eq-5`, :eq:`eq-6`), for"),
        ("Souden, Benesty and Affes 2010, Eq. (24)", "Souden, Benesty and Affes 2010, Eq. (24)"),
    ],
)
def test_numbers_of_equations_are_links(written: str, shown: str) -> None:
    from api_texts import link_equations

    assert link_equations(written) == shown


def test_bars_are_magnitudes_but_those_of_drawings_stay() -> None:
    from api_texts import keep_bars

    assert keep_bars(["w = |v|, and ``|x|``"]) == [r"w = \|v\|, and ``|x|``"]
    drawing = ["A plate::", "", "    | w |"]
    assert keep_bars(drawing) == drawing


def test_a_notebook_is_shown_with_results_unless_it_was_changed_since(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import notebook_pages

    for name in ("stored", "executed", "pages"):
        (tmp_path / name).mkdir()
        monkeypatch.setattr(notebook_pages, name.upper(), tmp_path / name)
    stored, executed, page = (tmp_path / name / "tour.ipynb" for name in ("stored", "executed", "pages"))
    app: Any = None

    def write(path: Path, text: str, time: float) -> None:
        cell = {"cell_type": "markdown", "source": ["# A tour\n", text]}
        path.write_text(json.dumps({"cells": [cell]}))
        os.utime(path, (time, time))

    write(stored, "without", 1.0)
    notebook_pages.write_pages(app)
    assert "without" in page.read_text()
    assert "[A tour](tour.ipynb)" in (tmp_path / "pages" / "index.md").read_text()
    write(executed, "with", 2.0)
    notebook_pages.write_pages(app)
    assert "without" not in page.read_text()
    write(stored, "without, changed", 3.0)
    notebook_pages.write_pages(app)
    assert "changed" in page.read_text()
    stored.unlink()
    notebook_pages.write_pages(app)
    assert not page.exists()
