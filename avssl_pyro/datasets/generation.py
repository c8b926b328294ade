"""Parallel, resumable generation of data sets, with the same bytes on every machine.

During generation a folder contains ``generation.json`` with the settings, and ``scenes-*.tar.done.json`` with the
record of each finished shard. A record is written just before its shard is renamed into place. A shard that agrees
with its record in size is finished and never rendered again. In the end all records are gathered in ``manifest.json``.

Each shard is one joblib task, which writes its own file. On a cluster all workers and this process need the folder
under the same path. Select a cluster by ``joblib.parallel_config(backend="dask")`` (or ``"ray"``).
"""

import functools
import hashlib
import os
import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import joblib
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.atomic_file import remove_temporaries, write_atomically
from avssl_pyro.datasets.encoding import Scene
from avssl_pyro.datasets.folder_lock import sole_writer
from avssl_pyro.datasets.manifest import (
    MANIFEST_NAME,
    DatasetSpec,
    Manifest,
    ShardRecord,
    first_difference,
    read_json,
    shard_name,
    to_json,
)
from avssl_pyro.datasets.shards import build_shard, shard_problem
from avssl_pyro.errors import InputError

GENERATION_NAME = "generation.json"
DONE_SUFFIX = ".done.json"
SCENES_PER_SHARD = 100

# In a worker started by joblib on this machine: the generating process.
_PARENT = os.getppid()


class Simulator(Protocol):
    """Renders scene number ``index``; picklable, and a pure function of its fields and the index."""

    def render(self, index: int) -> Scene: ...


@dataclass(frozen=True)
class GenerationPlan:
    """Description of a dataset to generate.

    Args:
        folder: folder of the shards, created if missing.
        simulator: simulator of the scenes.
        configuration: all settings of ``simulator`` as plain JSON values, compared when work is resumed.
        seed: seed of the simulator.
        array: microphones that ``simulator`` renders.
        num_scenes: number of scenes, with indices 0 to ``num_scenes`` - 1.
        scenes_per_shard: number of scenes in one tar file and one parallel task.
        action: verb on the progress bar.
    """

    folder: Path
    simulator: Simulator
    configuration: dict[str, Any]
    seed: int
    array: MicrophoneArray
    num_scenes: int
    scenes_per_shard: int = SCENES_PER_SHARD
    action: str = "simulate"

    @property
    def spec(self) -> DatasetSpec:
        return DatasetSpec(self.configuration, self.seed, self.array, self.num_scenes, self.scenes_per_shard)


@contextmanager
def processes(workers: int | None = None, scheduler: str | None = None) -> Iterator[None]:
    """Context in which :func:`generate` uses processes of this machine or of a Dask cluster.

    Args:
        workers: number of processes; None is one per core, or all of the cluster.
        scheduler: address of a Dask scheduler, such as tcp://host:8786; None for local processes.

    Raises:
        InputError: Dask is not installed.
    """
    if scheduler is None:
        with joblib.parallel_config(n_jobs=workers or -1):
            yield
        return
    try:
        import distributed  # noqa: PLC0415
    except ImportError as error:
        raise InputError(
            "a Dask scheduler was given, but Dask is not installed; install it with: pip install 'avssl-pyro[cluster]'."
        ) from error
    client = distributed.Client(scheduler)
    with client, joblib.parallel_config("dask", n_jobs=workers or -1):
        yield


def generate(plan: GenerationPlan, workers: int | None = None, progress: bool = True) -> Manifest:
    """Generates the missing shards of ``plan`` and returns the manifest.

    Args:
        plan: description of the dataset.
        workers: number of processes (joblib's ``n_jobs``, so -1 is one per core); None takes it from the surrounding
            ``joblib.parallel_config``.
        progress: True shows a progress bar.

    Raises:
        InputError: the folder has other scenes (the message names the first differing setting) or foreign shards, or a
            shard made again differs from its record in the manifest.
        OSError: a file cannot be written. Finished shards stay, unfinished files are removed.
    """
    spec = plan.spec
    plan.folder.mkdir(parents=True, exist_ok=True)
    with sole_writer(plan.folder):
        remove_temporaries(plan.folder)
        recorded = _claim(plan)
        finished = {
            number: record
            for number, record in recorded.items()
            if shard_problem(plan.folder, record, contents=False) is None
        }
        missing = [number for number in range(spec.num_shards) if number not in finished]
        try:
            for number, made in _make(plan, missing, workers, progress):
                _check_made(plan.folder, made, recorded.get(number))
                finished[number] = made
        finally:
            # A task that was stopped because another one failed leaves its file behind.
            remove_temporaries(plan.folder)
        manifest = Manifest(spec, tuple(finished[number] for number in range(spec.num_shards)))
        if not (plan.folder / MANIFEST_NAME).exists():
            manifest.save(plan.folder)
        _remove_notes(plan.folder)
    return manifest


def _claim(plan: GenerationPlan) -> dict[int, ShardRecord]:
    """Checks that the folder belongs to this plan, and returns the records of its finished shards by number."""
    wanted = plan.spec.to_dict()
    for name in (MANIFEST_NAME, GENERATION_NAME):
        path = plan.folder / name
        if path.exists():
            stored = read_json(path)
            header = {key: value for key, value in stored.items() if key != "shards"} if type(stored) is dict else {}
            difference = first_difference(header, wanted)
            if difference is not None:
                field, old, new = difference
                raise InputError(
                    f"{plan.folder} has scenes made with {field} = {old!r}, not {new!r}; "
                    "use the same settings or another folder."
                )
            if name == MANIFEST_NAME:
                return dict(enumerate(Manifest.load(plan.folder).shards))
            return _read_notes(plan)
    if any(plan.folder.glob("scenes-*.tar")):
        raise InputError(f"{plan.folder} has shards but no {MANIFEST_NAME}; use an empty folder.")
    write_atomically(plan.folder / GENERATION_NAME, to_json(wanted))
    return {}


def _read_notes(plan: GenerationPlan) -> dict[int, ShardRecord]:
    notes = {}
    for number in range(plan.spec.num_shards):
        path = plan.folder / (shard_name(number) + DONE_SUFFIX)
        if path.exists():
            notes[number] = ShardRecord.from_dict(read_json(path), where=str(path))
    return notes


def _remove_notes(folder: Path) -> None:
    for note in folder.glob(f"scenes-*.tar{DONE_SUFFIX}"):
        note.unlink(missing_ok=True)
    (folder / GENERATION_NAME).unlink(missing_ok=True)


def _check_made(folder: Path, made: ShardRecord, recorded: ShardRecord | None) -> None:
    if recorded is not None and recorded != made:
        (folder / made.name).unlink(missing_ok=True)
        raise InputError(
            f"shard {folder / made.name} differs from its record; the assets or the program have changed, "
            "so make the scenes again in another folder."
        )
    problem = shard_problem(folder, made, contents=False)
    if problem is not None:
        raise InputError(f"{problem} A worker wrote it just now: do all workers share this folder under this path?")


def _make(
    plan: GenerationPlan, missing: list[int], workers: int | None, progress: bool
) -> Iterator[tuple[int, ShardRecord]]:
    pickled = pickle.dumps(plan.simulator)
    # joblib reuses its processes, whose working directory may be an earlier one.
    folder = plan.folder.resolve()
    tasks = (
        joblib.delayed(_make_shard)(folder, number, plan.spec.scenes_of(number), pickled, os.getpid())
        for number in missing
    )
    results = joblib.Parallel(n_jobs=workers, return_as="generator_unordered")(tasks)
    todo = sum(len(plan.spec.scenes_of(number)) for number in missing)
    bar = tqdm(
        total=plan.num_scenes,
        initial=plan.num_scenes - todo,
        desc=plan.action,
        unit="scene",
        smoothing=0.1,
        disable=not (progress and missing),
    )
    with bar:
        for number, record in results:
            yield number, record
            bar.update(record.num_scenes)


def _make_shard(folder: Path, number: int, scenes: range, pickled: bytes, driver: int) -> tuple[int, ShardRecord]:
    # Parallelism is over shards; threads inside would only compete, and might sum in another order.
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        simulator = _simulator(pickled)
        content = build_shard(_unless_orphaned(simulator.render(index), driver) for index in scenes)
    finally:
        cv2.setNumThreads(threads)
    path = folder / shard_name(number)
    record = ShardRecord(path.name, len(scenes), len(content), hashlib.sha256(content).hexdigest())
    write_atomically(path.with_name(path.name + DONE_SUFFIX), to_json(record.to_dict()))
    write_atomically(path, content)
    return number, record


def _unless_orphaned(scene: Scene, driver: int) -> Scene:
    # joblib's processes finish all queued tasks after their parent is killed, and would compete with its successor.
    if driver == _PARENT != os.getppid():
        os._exit(1)
    return scene


@functools.lru_cache(maxsize=1)
def _simulator(pickled: bytes) -> Simulator:
    """Unpickles a simulator; a worker reuses it from task to task and loads its assets once."""
    return pickle.loads(pickled)
