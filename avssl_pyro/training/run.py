"""One training from its settings: data, a fresh or a started system, the loop, and a folder that can go on."""

import json
from collections.abc import Callable
from pathlib import Path

import cattrs
import torch
from lightning_fabric import Fabric

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.datasets.builtin import TRAIN, default_dataset
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.systems.checkpoint import load_checkpoint
from avssl_pyro.systems.config import PRETRAINED
from avssl_pyro.systems.pretrained import load_weights_of
from avssl_pyro.systems.system import System, SystemConfig, build_system
from avssl_pyro.training.config import ARRAY_OF_DATA, TrainingConfig
from avssl_pyro.training.elbo_terms import TraceELBOWithTerms, TraceMeanFieldELBOWithTerms
from avssl_pyro.training.process import keep_freed_memory
from avssl_pyro.training.state import STATE_NAME
from avssl_pyro.training.svi import CHECKPOINT_NAME, train

ESTIMATORS = {"mean-field": TraceMeanFieldELBOWithTerms, "trace": TraceELBOWithTerms}
RUN_NAME = "run.json"


def run_training(options: TrainingConfig, on_end: Callable[[Path], None] | None = None) -> Path | None:
    """Trains a system and writes its checkpoint, log and settings to ``options.out``.

    Args:
        options: settings of the training.
        on_end: function of the run's folder, called by the first process however training ends; draws the curves.

    Returns:
        Path of the checkpoint in the first process, None in the others.

    Raises:
        InputError: a setting or a file cannot be used, or the folder holds a run with other settings.
        TrainingDivergedError: the loss is no longer finite.
    """
    keep_freed_memory()
    array = _array(options)
    fabric = _fabric(options)
    fabric.launch()
    dataset = _dataset(options, array, progress=fabric.is_global_zero)
    _claim_run(options, array, fabric.world_size)
    torch.manual_seed(options.optimization.seed)
    system = build_system(SystemConfig(array, options.model, options.guide, options.stft))
    if options.start_from is not None:
        _copy_weights(system, _start(options.start_from), options.start_from)
    estimator = ESTIMATORS[options.estimator]()
    try:
        train(system, dataset, options.optimization, options.out, fabric, estimator, options.targets)
    finally:
        if on_end is not None and fabric.is_global_zero:
            on_end(options.out)
    return options.out / CHECKPOINT_NAME if fabric.is_global_zero else None


def _start(file_or_name: str) -> System:
    """A checkpoint by path, or pretrained weights by name."""
    path = Path(file_or_name)
    if file_or_name in PRETRAINED and not path.exists():
        return load_weights_of(file_or_name)
    return load_checkpoint(path)


def _copy_weights(system: System, start: System, where: str) -> None:
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


def _array(options: TrainingConfig) -> MicrophoneArray:
    if options.array != ARRAY_OF_DATA:
        return resolve_array(options.array)
    if not options.data:
        raise InputError(
            f"preset {options.preset} with --array {ARRAY_OF_DATA} needs --data: a folder of clips made by prepare.py."
        )
    return SceneDataset(options.data).array


def _fabric(options: TrainingConfig) -> Fabric:
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


def _claim_run(options: TrainingConfig, array: MicrophoneArray, processes: int) -> None:
    """Writes the settings of a run, or compares them with the run to be continued."""
    settings = {
        "array": array.to_dict(),
        "data": [str(folder) for folder in options.data]
        or {"scenes": options.num_scenes, "condition": options.condition},
        "start_from": options.start_from,
        "estimator": options.estimator,
        "precision": options.precision,
        "processes": processes,
        "model": cattrs.unstructure(options.model),
        "guide": cattrs.unstructure(options.guide),
        "stft": cattrs.unstructure(options.stft),
        "targets": cattrs.unstructure(options.targets),
        "optimization": cattrs.unstructure(options.optimization),
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


def _dataset(options: TrainingConfig, array: MicrophoneArray, progress: bool) -> SceneDataset:
    if options.data:
        return SceneDataset(options.data, array)
    return default_dataset(options.cache, TRAIN, options.condition, options.num_scenes, array, progress)
