"""Training: it learns, it is exactly reproducible and resumable, and it tells what went wrong."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import torch
from attrs import evolve
from lightning_fabric import Fabric

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.systems.checkpoint import load_checkpoint
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.systems.system import System, SystemConfig, build_system
from avssl_pyro.training.config import DistillationConfig, OptimizationConfig
from avssl_pyro.training.divergence import TrainingDivergedError
from avssl_pyro.training.elbo_terms import TraceELBOWithTerms
from avssl_pyro.training.metrics_logger import read_log
from avssl_pyro.training.svi import CHECKPOINT_NAME, train

SMALL = GuideConfig(visual_channels=(4, 8), audio_channels=8)
CONFIG = OptimizationConfig(epochs=2, batch_size=2, warmup_steps=2, num_workers=0, log_every=1)


LONG = evolve(CONFIG, epochs=6)


def small_system(seed: int = 0, guide: GuideConfig = SMALL) -> System:
    torch.manual_seed(seed)
    return build_system(SystemConfig(PRESETS["circle4"], guide=guide))


def fabric() -> Fabric:
    return Fabric(accelerator="cpu", devices=1)


@pytest.fixture
def dataset(scene_folder: Path) -> SceneDataset:
    return SceneDataset(scene_folder, PRESETS["circle4"])


def without_speed(records: list[dict[str, float]]) -> list[dict[str, float]]:
    return [{name: value for name, value in record.items() if name != "clips_per_second"} for record in records]


def test_the_elbo_rises_and_every_term_is_logged(dataset: SceneDataset, tmp_path: Path) -> None:
    system = small_system()
    train(system, dataset, evolve(CONFIG, epochs=6, learning_rate=1e-2), tmp_path, fabric())
    records = read_log(tmp_path)
    first, last = records[:5], records[-5:]
    assert sum(record["loss"] for record in last) < sum(record["loss"] for record in first)
    for record in records:
        kl = record["kl_direction_weights"] + record["kl_mixing_levels"]
        assert -record["loss"] == pytest.approx(record["log_likelihood"] - kl, rel=1e-4)
        assert record["beta"] > 0
        assert record["sigma_0"] > 0
    assert (tmp_path / "tensorboard").is_dir()


def test_a_resumed_run_gives_the_numbers_of_an_uninterrupted_one(dataset: SceneDataset, tmp_path: Path) -> None:
    whole, parts = small_system(), small_system()
    train(whole, dataset, CONFIG, tmp_path / "whole", fabric())
    for stop_after in (3, 7, None):
        # Every part starts from other weights, as a new process would; all must come from the saved state.
        parts = small_system(seed=99 if stop_after != 3 else 0)
        train(parts, dataset, CONFIG, tmp_path / "parts", fabric(), stop_after=stop_after)
    for name, value in whole.state_dict().items():
        assert torch.equal(value, parts.state_dict()[name]), name
    assert without_speed(read_log(tmp_path / "whole")) == without_speed(read_log(tmp_path / "parts"))


def test_refined_targets_are_logged_and_resumed_exactly(dataset: SceneDataset, tmp_path: Path) -> None:
    targets = DistillationConfig(weight=0.1, rounds=2, warmup=0.3)
    whole, parts = small_system(), small_system()
    train(whole, dataset, CONFIG, tmp_path / "whole", fabric(), targets=targets)
    for stop_after in (3, None):
        train(parts, dataset, CONFIG, tmp_path / "parts", fabric(), targets=targets, stop_after=stop_after)
    assert all(torch.equal(value, parts.state_dict()[name]) for name, value in whole.state_dict().items())
    assert read_log(tmp_path / "whole")[-1]["direction_cross_entropy"] > 0
    plain = small_system()
    train(plain, dataset, CONFIG, tmp_path / "plain", fabric())
    assert not torch.equal(plain.guide.log_sigma_k, whole.guide.log_sigma_k)


def test_a_frozen_visual_network_stays_as_it_is_while_the_rest_learns(dataset: SceneDataset, tmp_path: Path) -> None:
    system = small_system()
    before = {name: value.clone() for name, value in system.state_dict().items()}
    train(system, dataset, evolve(CONFIG, freeze_visual=True), tmp_path, fabric())
    for name, value in system.state_dict().items():
        learns = not name.startswith("guide.visual.")
        assert torch.equal(value, before[name]) != learns, name


def test_the_number_of_reading_workers_changes_nothing(dataset: SceneDataset, tmp_path: Path) -> None:
    alone, helped = small_system(), small_system()
    config = evolve(CONFIG, epochs=1)
    train(alone, dataset, config, tmp_path / "alone", fabric())
    train(helped, dataset, evolve(config, num_workers=1), tmp_path / "helped", fabric())
    assert all(torch.equal(value, helped.state_dict()[name]) for name, value in alone.state_dict().items())


def test_ctrl_c_saves_and_the_run_goes_on(dataset: SceneDataset, tmp_path: Path) -> None:
    def interrupt_after_two_steps() -> None:
        while len(read_log(tmp_path)) < 2:
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    whole, parts = small_system(), small_system()
    train(whole, dataset, LONG, tmp_path / "whole", fabric())
    thread = threading.Thread(target=interrupt_after_two_steps)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        train(parts, dataset, LONG, tmp_path, fabric())
    thread.join()
    parts = small_system(seed=1)
    train(parts, dataset, LONG, tmp_path, fabric())
    assert all(torch.equal(value, parts.state_dict()[name]) for name, value in whole.state_dict().items())


def test_a_finished_run_is_not_trained_again(dataset: SceneDataset, tmp_path: Path) -> None:
    system = small_system()
    train(system, dataset, evolve(CONFIG, epochs=1), tmp_path, fabric())
    before = {name: value.clone() for name, value in system.state_dict().items()}
    train(system, dataset, evolve(CONFIG, epochs=1), tmp_path, fabric())
    assert all(torch.equal(value, system.state_dict()[name]) for name, value in before.items())


def test_the_checkpoint_holds_the_trained_weights(dataset: SceneDataset, tmp_path: Path) -> None:
    system = small_system()
    train(system, dataset, evolve(CONFIG, epochs=1), tmp_path, fabric())
    loaded = load_checkpoint(tmp_path / CHECKPOINT_NAME)
    assert all(torch.equal(value, loaded.state_dict()[name]) for name, value in system.state_dict().items())
    config = json.loads((tmp_path / CHECKPOINT_NAME).with_suffix(".json").read_text())
    assert config["array"]["name"] == "circle4"


def test_a_nan_stops_with_the_step_the_term_and_the_clip(dataset: SceneDataset, tmp_path: Path) -> None:
    system = small_system()
    with torch.no_grad():
        system.guide.log_sigma_k[0] = float("nan")
    with pytest.raises(TrainingDivergedError, match=r"^step 0: the ELBO term log_likelihood .* clip 00000\d"):
        train(system, dataset, CONFIG, tmp_path, fabric())
    assert not (tmp_path / CHECKPOINT_NAME).exists()


def test_trace_elbo_and_the_guide_without_audio_network_train_too(dataset: SceneDataset, tmp_path: Path) -> None:
    system = small_system(guide=evolve(SMALL, audio_net=False))
    targets = DistillationConfig(weight=0.1, warmup=0.0)
    train(system, dataset, evolve(CONFIG, epochs=1), tmp_path, fabric(), TraceELBOWithTerms(), targets)
    assert read_log(tmp_path)[-1]["direction_cross_entropy"] > 0
    assert "beta" not in read_log(tmp_path)[-1]


def test_bfloat16_networks_leave_the_likelihood_in_full_precision(dataset: SceneDataset, tmp_path: Path) -> None:
    runs = {}
    for precision in ("32-true", "bf16-mixed"):
        train(
            small_system(),
            dataset,
            evolve(CONFIG, epochs=1),
            tmp_path / precision,
            Fabric(accelerator="cpu", devices=1, precision=precision),
        )
        runs[precision] = read_log(tmp_path / precision)[0]["log_likelihood"]
    assert runs["bf16-mixed"] == pytest.approx(runs["32-true"], abs=0.02)


def test_a_finished_run_whose_checkpoint_is_gone_writes_it_again(dataset: SceneDataset, tmp_path: Path) -> None:
    system = small_system()
    train(system, dataset, evolve(CONFIG, epochs=1), tmp_path, fabric())
    (tmp_path / CHECKPOINT_NAME).unlink()
    train(small_system(seed=1), dataset, evolve(CONFIG, epochs=1), tmp_path, fabric())
    written = load_checkpoint(tmp_path / CHECKPOINT_NAME).state_dict()
    assert all(torch.equal(value, written[name]) for name, value in system.state_dict().items())


@pytest.mark.parametrize("num_workers", [0, 1])
def test_an_altered_shard_is_told_in_one_sentence(scene_folder: Path, tmp_path: Path, num_workers: int) -> None:
    folder = tmp_path / "scenes"
    shutil.copytree(scene_folder, folder)
    shard = min(folder.glob("*.tar"))
    content = bytearray(shard.read_bytes())
    content[len(content) // 2] ^= 1
    shard.write_bytes(content)
    altered = SceneDataset(folder, PRESETS["circle4"])
    with pytest.raises(InputError, match=rf"^[^\n]*{shard.name}[^\n]*$"):
        train(small_system(), altered, evolve(CONFIG, num_workers=num_workers), tmp_path / "run", fabric())


@pytest.mark.parametrize("damage", [b"", b"not a checkpoint", None])
def test_a_damaged_state_is_refused(dataset: SceneDataset, tmp_path: Path, damage: bytes | None) -> None:
    train(small_system(), dataset, CONFIG, tmp_path, fabric(), stop_after=1)
    path = tmp_path / "training_state.pt"
    path.write_bytes(path.read_bytes()[:500] if damage is None else damage)
    with pytest.raises(InputError, match=r"training_state\.pt: cannot be resumed from"):
        train(small_system(), dataset, CONFIG, tmp_path, fabric())


TWO_PROCESSES = """
import sys
from pathlib import Path
import torch
from lightning_fabric import Fabric
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.systems.checkpoint import save_checkpoint
from avssl_pyro.systems.system import SystemConfig, build_system
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.training.svi import train
from avssl_pyro.training.config import OptimizationConfig

folder, out, batch_size = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
fabric = Fabric(accelerator="cpu", devices=int(sys.argv[4]))
fabric.launch()
torch.manual_seed(0)
# Latent noise differs between processes by design; at this sigma it vanishes in float32, and levels are fixed.
guide = GuideConfig(visual_channels=(4, 8), dropout=0.0, audio_net=False, initial_sigma=1e-12)
system = build_system(SystemConfig(PRESETS["circle4"], guide=guide))
for module in system.guide.modules():
    if isinstance(module, torch.nn.BatchNorm2d):
        # Statistics of a batch are those of a process; frozen, the gradient is a plain mean over clips.
        module.train = lambda mode=True, module=module: module
        module.eval()
        module.training = False
config = OptimizationConfig(epochs=1, batch_size=batch_size, warmup_steps=2, num_workers=0, log_every=1)
train(system, SceneDataset(folder, PRESETS["circle4"]), config, out, fabric)
torch.save(system.state_dict(), out / f"rank{fabric.global_rank}.pt")
"""


@pytest.mark.timeout(240)
def test_two_processes_train_as_one_with_the_doubled_batch(scene_folder: Path, tmp_path: Path) -> None:
    script = tmp_path / "two.py"
    script.write_text(TWO_PROCESSES)
    states = {}
    for name, batch_size, devices in (("one", 4, 1), ("two", 2, 2)):
        out = tmp_path / name
        arguments = [str(script), str(scene_folder), str(out), str(batch_size), str(devices)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        done = subprocess.run(
            [sys.executable, *arguments], capture_output=True, text=True, check=False, env=environment, timeout=200
        )
        assert done.returncode == 0, done.stderr[-2000:]
        states[name] = [torch.load(path, weights_only=True) for path in sorted(out.glob("rank*.pt"))]
    assert [len(states[name]) for name in ("one", "two")] == [1, 2]
    (one,), (first, second) = states["one"], states["two"]
    for name, value in one.items():
        assert torch.equal(first[name], second[name]), name
        torch.testing.assert_close(first[name], value, rtol=1e-4, atol=1e-5)
