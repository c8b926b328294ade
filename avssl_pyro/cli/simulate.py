"""Renders, previews or verifies labelled scenes: ``avssl simulate``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from avssl_pyro.cli.options import DEFAULT_SEED, DEFAULT_WORKERS, AssetOptions, Seed, Workers, parse_options
from avssl_pyro.errors import InputError

if TYPE_CHECKING:
    from avssl_pyro.simulation.scenes import SceneSimulator

EXIT_UNSOUND = 1


@dataclass(frozen=True)
class SimulateOptions:
    """Render audio-visual scenes and store them as WebDataset shards.

    Synthetic material replaces --speech, --people or --panoramas where they are not given. The same --seed gives the
    same bytes; sets that must not share scenes need different seeds. After an interruption, the same command continues
    where it stopped.
    """

    out: Path | None = None
    """Folder of the shards; on a cluster, one that all workers share."""
    num_scenes: int = 2000
    """Number of scenes."""
    condition: Literal["all-speak", "some-silent", "wide"] = "some-silent"
    """all-speak: two or three people, all of them talkers; some-silent: two to four people, two or three talkers; wide:
    up to five people and four talkers in rooms of any size, with noise and inexact microphones, for training."""
    acoustics: Literal["image-method", "image-method-with-tail", "ray-traced"] | None = None
    """Model of the rooms' acoustics; by default that of --condition. ray-traced is meant for tests: walls scatter and
    absorb by frequency, as in no scene for training."""
    material: Annotated[AssetOptions, tyro.conf.arg(name="")] = field(default_factory=AssetOptions)
    array: str = "circle246"
    """Array to render: a preset or a YAML file. Shards of circle246 can be read as circle2, circle4 or circle6."""
    seed: Seed = DEFAULT_SEED
    shard_size: int = 100
    """Scenes per tar file."""
    workers: Workers = DEFAULT_WORKERS
    scheduler: str | None = None
    """Address of a Dask scheduler, such as tcp://host:8786, whose workers replace local processes."""
    preview: Annotated[Path | None, tyro.conf.arg(metavar="FILE.png")] = None
    """Contact sheet of up to twelve scenes with their true azimuths; without --out nothing else is written."""
    verify: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of shards to verify instead of rendering; one line per problem, and exit code 1 if there are any."""


def parse(args: Sequence[str] | None = None) -> SimulateOptions:
    """Returns the options of the command line."""
    return parse_options(SimulateOptions, args)


def main(args: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit code.

    Args:
        args: words of the command line; by default those of the process.

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    from avssl_pyro.io.images import write_png

    options = parse(args)
    if options.verify is not None:
        return _verify(options.verify)
    if options.num_scenes < 1:
        raise InputError(f"--num-scenes is {options.num_scenes}; give a number of at least 1.")
    if options.out is None and options.preview is None:
        raise InputError("say what to do: --out DIR makes scenes, --preview FILE.png shows some, --verify DIR checks.")
    simulator = _simulator(options)
    if options.out is not None:
        _generate(options, options.out, simulator)
    if options.preview is not None:
        write_png(options.preview, _preview(options, simulator))
        print(f"{options.preview}: written.")
    return 0


def _verify(folder: Path) -> int:
    from avssl_pyro.datasets.shards import verify_dataset

    problems = verify_dataset(folder, progress=True)
    for problem in problems:
        print(problem)
    if not problems:
        print(f"{folder}: sound.")
    return EXIT_UNSOUND if problems else 0


def _simulator(options: SimulateOptions) -> SceneSimulator:
    from avssl_pyro.acoustics.presets import resolve_array
    from avssl_pyro.simulation.acoustics.models import ROOM_MODELS
    from avssl_pyro.simulation.scene_config import SCENE_CONFIGS
    from avssl_pyro.simulation.scenes import SceneSimulator

    config = SCENE_CONFIGS[options.condition]
    if options.acoustics is not None:
        config = replace(config, acoustics=ROOM_MODELS[options.acoustics])
    return SceneSimulator(
        config=config,
        seed=options.seed,
        speech=options.material.speech_source(),
        people=options.material.person_source(),
        panoramas=options.material.panorama_source(),
        array=resolve_array(options.array),
    )


def _generate(options: SimulateOptions, out: Path, simulator: SceneSimulator) -> None:
    from avssl_pyro.datasets.generation import generate, processes
    from avssl_pyro.datasets.scene_plan import plan_scenes

    for source in (simulator.speech, simulator.people, simulator.panoramas):
        print(f"from {source.describe()}")
    plan = plan_scenes(out, simulator, options.num_scenes, options.shard_size)
    started = time.perf_counter()
    with processes(options.workers, options.scheduler):
        manifest = generate(plan)
    size_mb = sum(shard.num_bytes for shard in manifest.shards) / 1e6
    seconds = time.perf_counter() - started
    print(f"{out}: {options.num_scenes} scenes in {len(manifest.shards)} shards, {size_mb:.1f} MB, {seconds:.1f} s.")


def _preview(options: SimulateOptions, simulator: SceneSimulator) -> bytes:
    from avssl_pyro.datasets.dataset import SceneDataset
    from avssl_pyro.viz.contact_sheet import simulated_scenes_sheet, stored_scenes_sheet

    title = f"{options.condition}, seed {options.seed}, array {simulator.array.name}; solid: talks, dashed: silent"
    if options.out is None:
        return simulated_scenes_sheet(simulator, options.num_scenes, title)
    return stored_scenes_sheet(SceneDataset(options.out), f"{options.out}: {title}")
