"""Trains the networks by stochastic variational inference."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import torch
import tyro
from lightning_fabric import Fabric

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.acoustics.stft import StftConfig
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.cli.first_look import given
from avssl_pyro.datasets.builtin import TRAIN, default_dataset
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.systems.checkpoint import load_checkpoint
from avssl_pyro.systems.pretrained import MOST_GENERAL, PRETRAINED, load_weights_of
from avssl_pyro.systems.system import GuideConfig, ModelConfig, System, SystemConfig, build_system
from avssl_pyro.training.distillation import DistillationConfig
from avssl_pyro.training.divergence import TrainingDivergedError
from avssl_pyro.training.elbo_terms import TraceELBOWithTerms, TraceMeanFieldELBOWithTerms
from avssl_pyro.training.metrics_logger import read_log
from avssl_pyro.training.process import keep_freed_memory
from avssl_pyro.training.state import STATE_NAME
from avssl_pyro.training.svi import CHECKPOINT_NAME, OptimizationConfig, train
from avssl_pyro.viz.curves import save_curves

ESTIMATORS = {"mean-field": TraceMeanFieldELBOWithTerms, "trace": TraceELBOWithTerms}
RUN_NAME = "run.json"
ARRAY_OF_DATA = "data"
EXIT_DIVERGED = 1


@dataclass(frozen=True)
class TrainOptions:
    """Train the visual and the audio network on clips without labels.

    Without --data a small set of scenes is drawn and rendered first, and kept in --cache. Interrupted at any moment
    (ctrl-C, or killed), the same command goes on where it stopped.
    """

    preset: Literal["quick", "two-cores", "paper", "museum", "adapt"] = "quick"
    """Where the defaults below come from: quick is a few minutes on two cores, two-cores an hour, paper the original
    experiment (20000 scenes, 200 epochs), for a GPU; museum is its one on recordings, which prepare.py makes ready;
    adapt is a few minutes from the weights that come with the package to those of your recordings and your array."""
    out: Path = Path("runs/train")
    """Folder of the run: checkpoint, log, curves, TensorBoard events."""
    data: tuple[Path, ...] = ()
    """Folders of shards made by simulate.py or prepare.py; by default a small set made here."""
    cache: Path = Path("cache")
    """Where the default set is kept."""
    scenes: int = 3000
    """Size of the default set."""
    condition: Literal["all-speak", "some-silent"] = "some-silent"
    """Condition of the default set."""
    array: str = "circle6"
    """Microphone array: a preset (docs/arrays.md) or a YAML file; "data" is the array that the
    clips of --data were made with."""
    start_from: Annotated[str | None, tyro.conf.arg(metavar="FILE|NAME")] = None
    """Begin with the weights of this checkpoint, of the same networks and perhaps another array; circle2, circle4 and
    circle6 are those that come with the package."""
    estimator: Literal["mean-field", "trace"] = "mean-field"
    """Pyro's ELBO estimator: TraceMeanField_ELBO (analytic KL) or Trace_ELBO."""
    model: ModelConfig = field(default_factory=ModelConfig)
    guide: GuideConfig = field(default_factory=GuideConfig)
    stft: StftConfig = field(default_factory=StftConfig)
    targets: DistillationConfig = field(default_factory=DistillationConfig)
    optimization: OptimizationConfig = field(default_factory=OptimizationConfig)
    accelerator: Literal["auto", "cpu", "cuda"] = "auto"
    """Lightning Fabric accelerator: auto is cuda if there is one, else cpu."""
    devices: int = 1
    """Processes on this machine, one per device."""
    num_nodes: int = 1
    """Machines."""
    precision: Literal["32-true", "bf16-mixed"] = "32-true"
    """Precision of the networks; the likelihood is always computed in 32 bits or more."""


# A quarter of the frequencies, where speech is loud and the array not yet ambiguous, and less overlap of windows train
# six times as fast and localize no worse. Eight sectors leave few in which two people compete for one class; a class of
# its own hears diffuse noise.
_FAST = TrainOptions(
    model=ModelConfig(num_sources=9, bin_weight=3.0),
    guide=GuideConfig(diffuse_class=True, anchor_gain=3.0, augment=True),
    stft=StftConfig(hop=256, low_hz=200.0, high_hz=4000.0, bin_step=2),
    targets=DistillationConfig(weight=0.03, level_weight=4.0),
)
PRESETS: dict[str, TrainOptions] = {
    "quick": replace(_FAST, optimization=OptimizationConfig(epochs=3)),
    "two-cores": replace(_FAST, preset="two-cores", scenes=16_000, optimization=OptimizationConfig(epochs=4)),
    "paper": TrainOptions(
        preset="paper",
        scenes=20_000,
        optimization=OptimizationConfig(epochs=200, warmup_steps=0, final_learning_rate=1.0),
    ),
    # Sec. V: eight classes for a crowd and exhibits, and levels that need not be sparse.
    "museum": TrainOptions(
        preset="museum",
        array=ARRAY_OF_DATA,
        model=ModelConfig(num_sources=8, alpha=1.0, sigma=1.0, diffuse=0.1),
        optimization=OptimizationConfig(epochs=200, warmup_steps=0, final_learning_rate=1.0),
    ),
    # A few minutes of a recording would spoil a visual network that has seen thousands of rooms.
    "adapt": replace(
        _FAST,
        preset="adapt",
        array=ARRAY_OF_DATA,
        start_from=MOST_GENERAL,
        optimization=OptimizationConfig(epochs=5, warmup_steps=20, freeze_visual=True),
    ),
}


def parse(args: Sequence[str] | None = None) -> TrainOptions:
    """Options of the command line, on top of those of ``--preset``."""
    default = PRESETS.get(given("--preset", args) or "quick", PRESETS["quick"])
    return tyro.cli(TrainOptions, default=default, args=args)


def main(args: Sequence[str] | None = None) -> int:
    """Runs the command with ``args`` (by default those of the process) and returns its exit code.

    Raises:
        InputError, OSError, KeyboardInterrupt: told in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    try:
        train_with(parse(args))
    except TrainingDivergedError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_DIVERGED
    return 0


def train_with(options: TrainOptions) -> None:
    """Trains as the options say and draws the curves."""
    keep_freed_memory()
    array = _array(options)
    fabric = _fabric(options)
    fabric.launch()
    dataset = _dataset(options, array, progress=fabric.is_global_zero)
    _claim_run(options, array, fabric.world_size)
    torch.manual_seed(options.optimization.seed)
    system = build_system(SystemConfig(array, options.model, options.guide, options.stft))
    if options.start_from is not None:
        start_from(system, _start(options.start_from), options.start_from)
    estimator = ESTIMATORS[options.estimator]()
    try:
        train(system, dataset, options.optimization, options.out, fabric, estimator, options.targets)
    finally:
        if fabric.is_global_zero:
            draw_curves(options.out)
    if fabric.is_global_zero:
        print(f"{options.out / CHECKPOINT_NAME}: written.")


def _start(file_or_name: str) -> System:
    """A checkpoint by path, or shipped weights by name."""
    path = Path(file_or_name)
    if file_or_name in PRETRAINED and not path.exists():
        return load_weights_of(file_or_name)
    return load_checkpoint(path)


def start_from(system: System, start: System, where: str) -> None:
    """Gives a fresh system the weights of another, whose array may differ.

    Raises:
        InputError: its networks are not of the same shape.
    """
    try:
        system.load_state_dict(start.state_dict())
    except RuntimeError as error:
        problem = " ".join(str(error).split())[:300]
        raise InputError(
            f"{where}: its networks have other shapes ({problem}); give a checkpoint trained with the same --model, "
            "--guide and --stft."
        ) from error


def _array(options: TrainOptions) -> MicrophoneArray:
    if options.array != ARRAY_OF_DATA:
        return resolve_array(options.array)
    if not options.data:
        raise InputError(
            f"preset {options.preset} with --array {ARRAY_OF_DATA} wants --data: a folder of clips made by prepare.py."
        )
    return SceneDataset(options.data).array


def _fabric(options: TrainOptions) -> Fabric:
    # Apple's mps has no complex Cholesky factorisation, which the likelihood needs; "auto" must not choose it.
    automatic = "cuda" if torch.cuda.is_available() else "cpu"
    accelerator = automatic if options.accelerator == "auto" else options.accelerator
    try:
        return Fabric(
            accelerator=accelerator, devices=options.devices, num_nodes=options.num_nodes, precision=options.precision
        )
    except (RuntimeError, ValueError) as error:
        problem = " ".join(str(error).split())
        raise InputError(f"--accelerator {options.accelerator} --devices {options.devices}: {problem}") from error


def draw_curves(run_dir: Path) -> None:
    """Draws ``curves.png`` from the log of a run."""
    records = read_log(run_dir)
    if not records:
        return
    titles = {
        "elbo_gain": "ELBO per bin, above isotropic noise",
        "kl_direction_weights": "KL of direction weights, per bin",
        "kl_mixing_levels": "KL of mixing levels, per bin",
        "beta": "beta",
        "learning_rate": "learning rate",
    }
    series = {title: [record[name] for record in records] for name, title in titles.items() if name in records[-1]}
    sigmas = [name for name in records[-1] if name.startswith("sigma_")]
    series["sigma, mean over classes"] = [sum(record[name] for name in sigmas) / len(sigmas) for record in records]
    save_curves(run_dir / "curves.png", [record["step"] for record in records], series)


def _claim_run(options: TrainOptions, array: MicrophoneArray, processes: int) -> None:
    """Writes the settings of a run, or checks that they are those of the run that is to be continued."""
    settings = {
        "array": array.to_dict(),
        "data": [str(folder) for folder in options.data] or {"scenes": options.scenes, "condition": options.condition},
        "start_from": options.start_from,
        "estimator": options.estimator,
        "precision": options.precision,
        "processes": processes,
        "model": asdict(options.model),
        "guide": asdict(options.guide),
        "stft": asdict(options.stft),
        "targets": asdict(options.targets),
        "optimization": asdict(options.optimization),
    }
    settings = json.loads(json.dumps(settings))
    path = options.out / RUN_NAME
    # Without a saved state there is nothing to continue, and the settings may have been what was wrong.
    if path.exists() and (options.out / STATE_NAME).exists():
        try:
            previous = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise InputError(f"{path}: damaged ({error}); give another --out or delete the folder.") from error
        for section in ("model", "guide", "stft", "targets", "optimization"):
            for name, value in settings[section].items():
                _compare(path, f"{section}.{name}", previous.get(section, {}).get(name), value)
        for name in ("array", "data", "start_from", "estimator", "precision", "processes"):
            _compare(path, name, previous.get(name), settings[name])
        return
    options.out.mkdir(parents=True, exist_ok=True)
    write_atomically(path, json.dumps(settings, indent=1).encode())


# These may change when a run is continued without changing its numbers.
_HARMLESS = frozenset({"optimization.num_workers", "optimization.log_every", "optimization.checkpoint_minutes"})


def _compare(path: Path, name: str, previous: object, now: object) -> None:
    if previous != now and name not in _HARMLESS:
        raise InputError(
            f"{path}: this run was started with {name} = {previous}, not {now}; give another --out, or the same "
            "settings to continue it."
        )


def _dataset(options: TrainOptions, array: MicrophoneArray, progress: bool) -> SceneDataset:
    if options.data:
        return SceneDataset(options.data, array)
    return default_dataset(options.cache, TRAIN, options.condition, options.scenes, array, progress)
