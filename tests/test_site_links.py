"""Pages written for readers of the repository lead, in the site, to pages of the site."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("sphinx", reason="the documentation's tools are not installed")

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"


@pytest.fixture
def extension(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(DOCS / "_extensions")
    import source_links

    yield source_links
    for name in ("source_links", "api_pages"):
        sys.modules.pop(name)


MODULES = {ROOT / "models" / "priors.py": "avssl_pyro.models.priors"}


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        (
            "[`SparseDirichlet`](../models/priors.py)",
            "{py:obj}`SparseDirichlet <avssl_pyro.models.priors.SparseDirichlet>`",
        ),
        ("[priors](../models/priors.py)", "{py:mod}`priors <avssl_pyro.models.priors>`"),
        (
            "[`avssl_pyro.models.priors`](../models/priors.py)",
            "{py:mod}`avssl_pyro.models.priors <avssl_pyro.models.priors>`",
        ),
        ("[a tour](../notebooks/1-tour.ipynb)", "[a tour](/notebooks/1-tour.ipynb)"),
        ("[card](../avssl_pyro/weights/MODEL_CARD.md)", "[card](/model-card.md)"),
        ("[API](../avssl_pyro)", "[API](/api/index.rst)"),
        ("[doctor](doctor.md)", "[doctor](doctor.md)"),
    ],
)
def test_links_of_a_page(extension: ModuleType, written: str, shown: str) -> None:
    assert extension.rewrite(written, DOCS, MODULES) == shown


def test_links_of_a_notebook(extension: ModuleType) -> None:
    written = "[method](../docs/method.md#the-model) and [tables](2-priors.ipynb)"
    shown = "[method](/method.md#the-model) and [tables](2-priors.ipynb)"
    assert extension.rewrite(written, ROOT / "notebooks", MODULES) == shown


def test_every_module_has_a_page(extension: ModuleType) -> None:
    import api_pages

    files = {path for folder in ("avssl_pyro", "models", "guides") for path in (ROOT / folder).rglob("*.py")}
    assert {module.path for package in api_pages.packages() for module in (package, *package.inside)} == files
    pages = api_pages.pages()
    assert ".. automodule:: avssl_pyro.models.priors\n" in pages["avssl_pyro.models.priors"]
    assert "   avssl_pyro.models.priors\n" in pages["avssl_pyro.models"]
    assert "   avssl_pyro.models\n" in pages["index"]
