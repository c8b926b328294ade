"""Runs ``avssl benchmark {speed, elbo, combinations, calibration}``."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from avssl_pyro.cli.options import DEFAULT_SEED, Seed, choose_system, parse_options
from avssl_pyro.errors import InputError
from avssl_pyro.systems.config import MOST_GENERAL, GuideConfig, ModelConfig

if TYPE_CHECKING:
    from avssl_pyro.systems.system import System

EXIT_DISAGREES = 1
FRESH_ARRAY = "circle4"


@dataclass(frozen=True)
class SpeedOptions:
    """Measure time and memory of training, reading and localization on noise."""

    array: str = "circle6"
    """Microphone array: a preset or a YAML file."""
    batch_size: int = 16
    """Clips per training step."""
    num_repeats: int = 20
    """Number of timings of each task, of which the median is shown."""
    data: tuple[Path, ...] = ()
    """Folders of shards to read; by default a few rendered scenes."""


def speed(args: Sequence[str] | None = None) -> None:
    """Runs ``avssl benchmark speed``.

    Raises:
        InputError: an option is out of range.
    """
    options = parse_options(SpeedOptions, args)
    if options.num_repeats < 2 or options.batch_size < 1:
        raise InputError(
            f"--num-repeats {options.num_repeats} and --batch-size {options.batch_size} must be at least 2 and at "
            "least 1."
        )
    from avssl_pyro.acoustics.presets import resolve_array
    from avssl_pyro.benchmarks.speed import SpeedConfig, measure_speed

    config = SpeedConfig(resolve_array(options.array), options.batch_size, options.num_repeats, options.data)
    for table in measure_speed(config):
        table.print()


@dataclass(frozen=True)
class ElboOptions:
    """Compare Pyro's ELBO with its closed form and with enumerated masks.

    All are computed in double precision on simulated clips. Exit code 1 if exact quantities differ by more than 1e-9 or
    sampled ones by more than 4 standard errors.
    """

    checkpoint: Path | None = None
    """Checkpoint of 'avssl train'; by default a system with random weights."""
    array: str | None = None
    """Preset or YAML file of the array; by default that of --checkpoint, or circle4."""
    model: ModelConfig = field(default_factory=ModelConfig)
    guide: GuideConfig = field(default_factory=GuideConfig)
    num_clips: int = 2
    """Number of clips in the batch."""
    seconds: float = 0.25
    """Length of the clips in seconds, up to 1; enumerated masks need much memory."""
    num_draws: int = 50
    """Number of samples for the comparison with Trace_ELBO."""
    seed: Seed = DEFAULT_SEED


def elbo(args: Sequence[str] | None = None) -> int:
    """Runs ``avssl benchmark elbo`` and returns its exit code.

    Raises:
        InputError: an option is out of range, or the checkpoint has no audio network.
    """
    options = parse_options(ElboOptions, args)
    if not 0 < options.seconds <= 1 or options.num_clips < 1:
        raise InputError(
            f"--seconds {options.seconds} and --num-clips {options.num_clips} must be in (0, 1] and at least 1."
        )
    from avssl_pyro.benchmarks.elbo import compare_elbos
    from avssl_pyro.evaluation.tables import print_tables

    system = _checkpoint_or_fresh(options)
    agreement = compare_elbos(system, options.num_clips, options.seconds, options.num_draws, options.seed)
    print_tables(agreement.tables())
    print("agree." if agreement.agrees else "DISAGREE.")
    return 0 if agreement.agrees else EXIT_DISAGREES


def _checkpoint_or_fresh(options: ElboOptions) -> "System":
    if options.checkpoint is not None:
        system, _ = choose_system(options.checkpoint, options.array)
        if not system.config.guide.audio_net:
            raise InputError(
                f"{options.checkpoint}: has no audio network; the closed forms are those of the whole guide."
            )
        return system
    import torch

    from avssl_pyro.acoustics.presets import resolve_array
    from avssl_pyro.systems.system import SystemConfig, build_system

    torch.manual_seed(options.seed)
    return build_system(SystemConfig(resolve_array(options.array or FRESH_ARRAY), options.model, options.guide))


@dataclass(frozen=True)
class CombinationsOptions:
    """Compare combinations of priors, likelihoods and guides in a table.

    The columns are F-measure, count accuracy, ELBO and time. The thresholds of each are tuned on the validation clips.
    Finished rows are stored in --out, and the same command continues where it stopped.
    """

    checkpoint: Path | None = None
    """Checkpoint of 'avssl train'; by default the pretrained weights."""
    array: str | None = None
    """Preset or YAML file of the array; by default that of --checkpoint, or circle6."""
    validation_data: tuple[Path, ...] = ()
    """Folders of shards to tune thresholds on; by default scenes rendered into --cache."""
    test_data: tuple[Path, ...] = ()
    """Folders of shards to score; by default scenes rendered into --cache."""
    num_validation_scenes: int = 100
    """Largest number of scenes to tune on."""
    num_test_scenes: int = 200
    """Largest number of scenes to score."""
    num_combinations: int | None = None
    """Number of combinations to run, from the first; by default all."""
    cache: Path = Path("cache")
    """Folder of the default sets."""
    out: Path = Path("runs/combinations")
    """Folder for combinations.json, combinations.md and rows/."""
    seed: Seed = DEFAULT_SEED


def combinations(args: Sequence[str] | None = None) -> None:
    """Runs ``avssl benchmark combinations``.

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = parse_options(CombinationsOptions, args)
    sizes = (options.num_validation_scenes, options.num_test_scenes)
    if min(sizes) < 1:
        raise InputError(
            f"--num-validation-scenes {sizes[0]} and --num-test-scenes {sizes[1]}: both must be at least 1."
        )
    if options.num_combinations is not None and options.num_combinations < 1:
        raise InputError(
            f"--num-combinations is {options.num_combinations}; give at least 1, or leave it out for all combinations."
        )
    from avssl_pyro.benchmarks.combinations import recipes_for, run_combinations
    from avssl_pyro.datasets.builtin import TEST, VALIDATION, open_scenes

    system, array = choose_system(options.checkpoint, options.array, MOST_GENERAL)
    sets = (
        open_scenes(options.validation_data, array, options.cache, VALIDATION, "some-silent", sizes[0]),
        open_scenes(options.test_data, array, options.cache, TEST, "some-silent", sizes[1]),
    )
    recipes = recipes_for(system)[: options.num_combinations]
    run_combinations(recipes, system, sets, sizes, options.out, options.seed).print()
    print(f"{options.out / 'combinations.md'}: written, and combinations.json beside it.")


@dataclass(frozen=True)
class CalibrationOptions:
    """Test posteriors by simulation-based calibration.

    Scenes are drawn from a small model, and the truth must rank uniformly among posterior draws. Finished batches are
    stored in --out, and the same command continues where it stopped. Writes ranks.json and ranks.png.
    """

    out: Path = Path("runs/calibration")
    """Folder of the results."""
    posteriors: tuple[str, ...] = ("refined", "mean field")
    """Any of: 'refined', 'mean field', 'low rank', 'NUTS'; the last two are slow."""
    room: bool = False
    """Whether every class of the small model has a share of diffuse sound, as in a room."""
    num_trials: int = 60
    """Number of scenes to draw; 200 are more conclusive."""
    batch_size: int = 20
    """Number of scenes that are stored together, and sampled together by NUTS."""
    seed: Seed = DEFAULT_SEED


def calibration(args: Sequence[str] | None = None) -> None:
    """Runs ``avssl benchmark calibration``.

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = parse_options(CalibrationOptions, args)
    if options.num_trials < 1 or options.batch_size < 1:
        raise InputError(f"--num-trials {options.num_trials} and --batch-size {options.batch_size} must be at least 1.")
    if not options.posteriors:
        raise InputError("--posteriors: name at least one.")
    from avssl_pyro.benchmarks.calibration import POSTERIORS, ToyModel, run_calibration

    if unknown := [name for name in options.posteriors if name not in POSTERIORS]:
        raise InputError(f"--posteriors: there is no '{unknown[0]}'; choose from {', '.join(POSTERIORS)}.")
    report = run_calibration(
        ToyModel(room=options.room),
        options.posteriors,
        options.num_trials,
        options.batch_size,
        options.out,
        options.seed,
    )
    report.write(options.out)
    report.table().print()
    print(f"{options.out / 'ranks.json'}: written, and ranks.png beside it.")
