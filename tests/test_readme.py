"""Every command and every example of the README and of docs/ is run, in small."""

import re
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import pyro
import pytest
import soundfile
import torch

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.cli import benchmark, compare_elbo, evaluate, localize, simulate, train
from avssl_pyro.data.dataset import SceneDataset
from avssl_pyro.inference.checkpoint import save_checkpoint
from avssl_pyro.inference.system import GuideConfig, SystemConfig, build_system

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
SCALING = (ROOT / "docs" / "scaling.md").read_text(encoding="utf-8")
SMALL_TRAINING = {
    "--scenes": "8",
    "--optimization.epochs": "1",
    "--optimization.batch-size": "4",
    "--optimization.num-workers": "0",
    "--guide.audio-channels": "8",
}
MAINS: dict[str, tuple[Callable[[Sequence[str]], object], dict[str, str]]] = {
    "simulate.py": (simulate.main, {"--scenes": "2", "--workers": "1"}),
    "svi_train.py": (train.main, SMALL_TRAINING),
    "evaluate.py": (
        evaluate.main,
        {"--checkpoint": "runs/demo/checkpoint.safetensors", "--test-scenes": "2", "--validation-scenes": "2"},
    ),
    "localize.py": (localize.main, {"--refine": "2"}),
    "compare_elbo.py": (compare_elbo.main, {"--seconds": "0.05", "--clips": "1", "--draws": "4"}),
    "benchmark.py": (benchmark.main, {"--array": "circle2", "--batch-size": "2", "--repeats": "2"}),
}


def shell_commands(text: str) -> list[list[str]]:
    """Every command that starts a script, from code blocks and from tables, as words."""
    blocks = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL)).replace("\\\n", " ")
    inline = re.findall(r"`(python scripts/[^`]+)`", text)
    lines = [*blocks.splitlines(), *inline]
    words = [shlex.split(line, comments=True) for line in lines if "scripts/" in line]
    return [line[next(i for i, word in enumerate(line) if word.startswith("scripts/")) :] for line in words]


def in_small(arguments: list[str], smaller: dict[str, str]) -> list[str]:
    arguments = list(arguments)
    for option, value in smaller.items():
        if option in arguments:
            arguments[arguments.index(option) + 1] = value
        else:
            arguments += [option, value]
    return arguments


@pytest.fixture(scope="module")
def user_folder(tmp_path_factory: pytest.TempPathFactory, scene_folder: Path) -> Path:
    """A folder with the files that the README speaks of."""
    folder = tmp_path_factory.mktemp("user")
    clip = SceneDataset(scene_folder, PRESETS["circle6"])[0]
    cv2.imwrite(str(folder / "panorama.jpg"), cv2.cvtColor(clip.image_ijc, cv2.COLOR_RGB2BGR))
    soundfile.write(folder / "clip.wav", clip.audio_mn.T, 16_000)
    (folder / "clips.csv").write_text("audio,image\nclip.wav,panorama.jpg\n")
    (yaml,) = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    (folder / "my-array.yaml").write_text(yaml)
    torch.manual_seed(0)
    system = build_system(SystemConfig(PRESETS["circle6"], guide=GuideConfig(audio_channels=8)))
    save_checkpoint(folder / "runs" / "demo" / "checkpoint.safetensors", system)
    return folder


README_COMMANDS = shell_commands(README)


@pytest.mark.parametrize("command", README_COMMANDS, ids=[" ".join(command[:2]) for command in README_COMMANDS])
def test_a_command_of_the_readme_works(
    command: list[str], user_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(user_folder)
    script = Path(command[0]).name
    assert (ROOT / command[0]).is_file()
    main, smaller = MAINS[script]
    if command == ["scripts/localize.py"]:
        with pytest.raises(SystemExit) as exit_info:
            main(["--help"])
        assert exit_info.value.code == 0
        return
    if command == ["scripts/svi_train.py"]:
        # With no arguments at all it trains on the embedded scenes for minutes; here on fewer.
        smaller = {**smaller, "--out": "runs/plain"}
    assert main(in_small(command[1:], smaller)) in (None, 0)


def test_every_script_is_in_the_readme() -> None:
    named = {Path(command[0]).name for command in README_COMMANDS}
    scripts = {path.name for path in (ROOT / "scripts").glob("*.py")}
    assert scripts - {"demo.py"} == named


def test_the_python_example_runs_as_it_stands(capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    pyro.clear_param_store()
    exec(compile(example, "README.md", "exec"), {})
    assert float(capsys.readouterr().out)
    pyro.clear_param_store()


def test_commands_of_the_scaling_page_are_understood() -> None:
    commands = shell_commands(SCALING)
    assert {Path(command[0]).name for command in commands} == {"simulate.py", "svi_train.py"}
    for script, *arguments in commands:
        if Path(script).name == "svi_train.py":
            assert train.parse(arguments).data == (Path("/data/train"),)
        else:
            assert simulate.parse(arguments).out == Path("/data/train")


def test_every_picture_and_page_is_there() -> None:
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", README):
        assert (ROOT / target).is_file(), target
