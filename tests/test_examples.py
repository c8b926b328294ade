"""The examples in the docstrings of the public names run as they stand."""

import doctest
import importlib
from pathlib import Path

import cv2
import pytest
import soundfile

import avssl_pyro as av
from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.datasets.dataset import SceneDataset

ROOT = Path(__file__).resolve().parent.parent
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
OBJECTS = {name: getattr(av, name) for name in av.__all__} | {
    "resolve_array": resolve_array,
    "Model.localize": av.Model.localize,
}


def run_examples(tests: list[doctest.DocTest]) -> int:
    """The number of examples that were run; those that fail raise."""
    runner = doctest.DebugRunner(optionflags=OPTIONS)
    for test in tests:
        runner.run(test)
    return sum(len(test.examples) for test in tests)


@pytest.mark.parametrize("name", OBJECTS)
def test_a_public_name_has_an_example_that_works(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = OBJECTS[name]
    module = importlib.import_module(found.__module__)
    tests = doctest.DocTestFinder(recurse=False).find(found, name, module, vars(module).copy())
    assert run_examples(tests), f"{name} has no example"


def test_the_package_itself_has_an_example() -> None:
    assert run_examples(doctest.DocTestFinder(recurse=False).find(av, "avssl_pyro", globs={}))


def test_the_first_sample_of_the_readme_runs(
    scene_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sample = (ROOT / "README.md").read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    assert sample.startswith("import avssl_pyro as av\n")
    clip = SceneDataset(scene_folder, resolve_array("circle6"))[0]
    monkeypatch.chdir(tmp_path)
    soundfile.write("clip.flac", clip.audio_mn.T, 16_000)
    cv2.imwrite("panorama.jpg", clip.image_ijc[..., ::-1])
    exec(compile(sample, "README.md", "exec"), {})
    assert "degrees, level" in capsys.readouterr().out
    assert Path("overlay.png").is_file()
    assert list(Path("sounds").glob("clip-source1-*.wav"))
