"""Every command and every example of the README is run, in small, and those of docs/scaling.md are parsed."""

import json
import re
import shlex
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pyro
import pytest
import soundfile
import torch
from measured_room import write_room, write_speech

import avssl_pyro as av
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.cli import app, prepare, simulate, train
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.generation import generate
from avssl_pyro.datasets.scene_plan import plan_scenes
from avssl_pyro.simulation.scene_config import SceneConfig
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.systems.checkpoint import save_checkpoint
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.systems.system import SystemConfig, build_system

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
SCALING = (ROOT / "docs" / "scaling.md").read_text(encoding="utf-8")
SIMULATION = (ROOT / "docs" / "simulation.md").read_text(encoding="utf-8")
SMALL_TRAINING = {
    "--num-scenes": "8",
    "--optimization.epochs": "1",
    "--optimization.batch-size": "2",
    "--optimization.num-workers": "0",
    "--guide.audio-channels": "8",
}
# Options that make a command quick.
SMALLER: dict[str, dict[str, str]] = {
    "simulate": {"--num-scenes": "2", "--workers": "1"},
    "train": SMALL_TRAINING,
    "evaluate": {"--num-test-scenes": "2", "--num-validation-scenes": "2", "--rounds": "2", "--workers": "1"},
    "localize": {"--rounds": "2"},
    "doctor": {},
    "prepare": {},
    "gallery": {"--num-each": "1"},
    "score": {},
    "simulate-recordings": {"--seconds": "4", "--width": "288", "--frame-rate": "5"},
    "benchmark recordings": {"--rounds": "3"},
    "benchmark rooms": {"--num-clips": "1 1 3", "--workers": "1"},
    "benchmark tracking": {"--num-recordings": "1", "--talkers.seconds": "4"},
    "benchmark elbo": {"--seconds": "0.05", "--num-clips": "1", "--num-draws": "4"},
    "benchmark separation": {"--num-scenes": "1"},
    "benchmark combinations": {"--num-validation-scenes": "1", "--num-test-scenes": "1", "--num-combinations": "2"},
    "benchmark calibration": {"--num-trials": "2", "--batch-size": "2"},
    "benchmark camera": {"--num-recordings": "1", "--seconds": "8", "--width": "288"},
    "benchmark speed": {"--array": "circle2", "--batch-size": "2", "--num-repeats": "2"},
}


def shell_commands(text: str) -> list[tuple[str, ...]]:
    """Every command of avssl, from code blocks and from tables: its name, of one word or two, and its arguments."""
    blocks = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL)).replace("\\\n", " ")
    inline = re.findall(r"`(avssl [^`]+)`", text)
    commands = []
    for line in [*blocks.splitlines(), *inline]:
        # torchrun wants a file.
        _, avssl, rest = line.replace("scripts/svi_train.py", "avssl train").rpartition("avssl ")
        if avssl:
            words = shlex.split(rest, comments=True)
            size = 2 if words[0] == "benchmark" else 1
            commands.append((" ".join(words[:size]), *words[size:]))
    return commands


def in_small(arguments: list[str], smaller: dict[str, str]) -> list[str]:
    arguments = list(arguments)
    for option, value in smaller.items():
        if option in arguments:
            arguments[arguments.index(option) + 1] = value
        else:
            arguments += [option, *value.split()]
    return arguments


@pytest.fixture(scope="module")
def user_folder(tmp_path_factory: pytest.TempPathFactory, scene_folder: Path) -> Path:
    """A folder with the files that the README speaks of."""
    folder = tmp_path_factory.mktemp("user")
    clips = [SceneDataset(scene_folder, PRESETS["circle6"])[index] for index in range(3)]
    picture = cv2.cvtColor(clips[0].image_ijc, cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(folder / "panorama.jpg"), picture)
    soundfile.write(folder / "clip.flac", clips[0].audio_mn.T, 16_000)
    soundfile.write(folder / "clip4.wav", clips[0].audio_mn[:4].T, 16_000)
    (folder / "recordings").mkdir()
    soundfile.write(folder / "recordings" / "one.wav", clips[0].audio_mn[:4].T, 16_000)
    (folder / "recordings" / "labels.csv").write_text("file,azimuth_deg\none.wav,30\n")
    write_room(folder / "responses", PRESETS["circle4"], range(0, 360, 45))
    write_speech(folder / "speech")
    for name in ("labels.csv", "walk.csv"):
        (folder / name).write_text("0,0,0,30,0\n1,0,0,30,0\n")
    (folder / "clips.csv").write_text("audio,image\nclip.flac,panorama.jpg\n")
    soundfile.write(folder / "walk.wav", np.concatenate([clip.audio_mn for clip in clips], axis=1).T, 16_000)
    video = cv2.VideoWriter(str(folder / "walk.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (480, 240))
    for _ in range(30):
        video.write(cv2.resize(picture, (480, 240)))
    video.release()
    (yaml,) = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    (folder / "my-array.yaml").write_text(yaml)
    torch.manual_seed(0)
    robot = build_system(SystemConfig(PRESETS["circle6"], guide=GuideConfig(audio_channels=8)))
    save_checkpoint(folder / "runs" / "robot" / "checkpoint.safetensors", robot)
    recording = ["--video", str(folder / "walk.mp4"), "--audio", str(folder / "walk.wav")]
    prepare.main([*recording, "--array", "circle6", "--num-clips", "5000", "--out", str(folder / "clips")])
    distant = SceneSimulator(SceneConfig(distance_range_m=(1.2, 2.0)), seed=1)
    generate(plan_scenes(folder / "scenes", distant, 6, 6), workers=1, progress=False)
    return folder


README_COMMANDS = [command for command in shell_commands(README) if not command[0].startswith("--")]


@pytest.mark.parametrize("command", README_COMMANDS, ids=[" ".join(command[:2]) for command in README_COMMANDS])
def test_a_command_of_the_readme_works(
    command: tuple[str, ...], user_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(user_folder)
    name, *arguments = command
    smaller = SMALLER[name]
    if command == ("localize",):
        with pytest.raises(SystemExit) as exit_info:
            app.main(["localize", "--help"])
        assert exit_info.value.code == 0
        return
    if command == ("train",):
        # With no arguments at all it trains on the embedded scenes for minutes; here on fewer.
        smaller = {**smaller, "--out": "runs/plain"}
    if "adapt" in command:
        # The networks are those of the pretrained weights.
        smaller = {option: value for option, value in smaller.items() if not option.startswith("--guide")}
    if name == "simulate":
        smaller = {**smaller, "--out": f"few-{arguments[arguments.index('--out') + 1]}"}
    # The doctor's business is to find faults.
    codes = (0, 1) if name == "doctor" else (None, 0)
    assert app.main([*name.split(), *in_small(arguments, smaller)]) in codes


def test_every_command_is_in_the_readme() -> None:
    commands = {*app.COMMANDS, *(f"benchmark {name}" for name in app.BENCHMARKS)}
    assert commands - {"demo"} == {command[0] for command in README_COMMANDS}


def test_the_clip_to_try_is_written_and_localized(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"```sh\n(avssl simulate[^`]*tar -xf[^`]*)```", README)
    simulation, extraction = block.splitlines()
    app.main(shlex.split(simulation)[1:])
    subprocess.run(extraction, shell=True, check=True)
    truth = json.loads(Path("000000.json").read_text())["talker_azimuths_deg"]
    sources = av.load("circle6").localize("clip.flac", "panorama.jpg").sources
    assert sorted(source.azimuth_deg for source in sources) == pytest.approx(sorted(truth), abs=5)


PYTHON_SAMPLES = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


@pytest.mark.parametrize("number", range(len(PYTHON_SAMPLES)))
def test_a_python_sample_runs_as_it_stands(
    number: int, user_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(user_folder)
    with pyro.get_param_store().scope():
        exec(compile(PYTHON_SAMPLES[number], "README.md", "exec"), {})
    assert re.search(r"\d", capsys.readouterr().out)


def test_commands_of_the_scaling_page_are_understood() -> None:
    commands = shell_commands(SCALING)
    assert {command[0] for command in commands} >= {"simulate", "train"}
    for name, *arguments in commands:
        if name == "train" and arguments:
            assert train.parse(arguments).data == (Path("/data/train"),)
        elif name == "simulate" and "--out" in arguments:
            assert simulate.parse(arguments).out == Path("/data/train")


def test_commands_and_sample_of_the_simulation_page_are_understood(capsys: pytest.CaptureFixture[str]) -> None:
    commands = [simulate.parse(arguments) for name, *arguments in shell_commands(SIMULATION) if name == "simulate"]
    assert [(options.condition, options.acoustics) for options in commands] == [
        ("wide", None),
        ("wide", None),
        ("wide", "ray-traced"),
    ]
    (sample,) = re.findall(r"```python\n(.*?)```", SIMULATION, re.DOTALL)
    exec(compile(sample, "simulation.md", "exec"), {})
    assert "snr_db" in capsys.readouterr().out


def test_every_picture_and_page_is_there() -> None:
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", README):
        assert (ROOT / target).is_file(), target


PAGES = [ROOT / "README.md", ROOT / "avssl_pyro" / "weights" / "MODEL_CARD.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_nothing_is_left_to_fill_in(page: Path) -> None:
    assert not re.search(r"\b(RESULTS|TABLES|NUMBERS|ABLATION\d*|TODO)\b", page.read_text(encoding="utf-8"))
