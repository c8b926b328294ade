"""What the documentation site makes of pages, notebooks and docstrings that also serve readers of the repository."""

import importlib.util
import os
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("sphinx", reason="the documentation's tools are not installed")

ROOT = Path(__file__).resolve().parent.parent
PRIORS = "avssl_pyro.models.priors"


@pytest.fixture(scope="module")
def conf() -> ModuleType:
    spec = importlib.util.spec_from_file_location("docs_conf", ROOT / "docs" / "conf.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        ("[`SparseDirichlet`](../models/priors.py)", f"{{py:obj}}`SparseDirichlet <{PRIORS}.SparseDirichlet>`"),
        ("[`LogNormalWeights`](../../models/priors.py)", f"{{py:obj}}`LogNormalWeights <{PRIORS}.LogNormalWeights>`"),
        (f"[`{PRIORS}`](../models/priors.py)", f"{{py:mod}}`{PRIORS}`"),
        (
            "[`Mvdr`](avssl_pyro/separation/beamforming.py)",
            "{py:obj}`Mvdr <avssl_pyro.separation.beamforming.Mvdr>`",
        ),
        ("[a tour](../notebooks/1-tour.ipynb)", "[a tour](../notebooks/1-tour.ipynb)"),
        ("[doctor](doctor.md)", "[doctor](doctor.md)"),
    ],
)
def test_links_to_modules_lead_to_the_api(conf: ModuleType, written: str, shown: str) -> None:
    assert conf.link_api(f"See {written}.") == f"See {shown}."


def test_a_notebook_is_shown_with_results_unless_it_was_changed_since(conf: ModuleType, tmp_path: Path) -> None:
    stored, executed = tmp_path / "tour.ipynb", tmp_path / "executed.ipynb"

    def write(path: Path, time: float) -> None:
        path.touch()
        os.utime(path, (time, time))

    write(stored, 1.0)
    assert conf.freshest(stored, executed) == stored
    write(executed, 2.0)
    assert conf.freshest(stored, executed) == executed
    write(stored, 3.0)
    assert conf.freshest(stored, executed) == stored
