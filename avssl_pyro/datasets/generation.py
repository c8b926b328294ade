"""Making a dataset in parallel, so that it survives being killed anywhere and is the same bytes whoever made it.

While it is made, a folder holds ``generation.json`` (what is being made) and one ``scenes-*.tar.done.json`` per
finished shard, written just before the shard gets its name: a shard whose note and size agree is finished and never
rendered again. The last act gathers the notes in ``manifest.json``.

Each shard is one joblib task, which writes its file itself: on a cluster the folder must be one that all workers and
this process see under the same path. Select a cluster by ``joblib.parallel_config(backend="dask")`` (or ``"ray"``).
"""

import functools
import hashlib
import os
import pickle
from collections.abc import Iterator
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

# In a worker that joblib started here: the process that generates.
_PARENT = os.getppid()


class Simulator(Protocol):
    """Renders scene number ``index``: picklable, and a function of itself and the index alone."""

    def render(self, index: int) -> Scene: ...


@dataclass(frozen=True)
class GenerationPlan:
    """A dataset to be made.

    Args:
        folder: where; made if it does not exist.
        simulator: renders the scenes.
        configuration: all settings behind ``simulator``, as plain JSON values; compared when work is resumed.
        seed: of the simulator.
        array: the microphones that ``simulator`` renders.
        num_scenes: how many scenes, indices 0 to ``num_scenes`` - 1.
        scenes_per_shard: scenes in one tar file and one parallel task.
        action: what the progress bar says is being done.
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


def generate(plan: GenerationPlan, workers: int | None = None, progress: bool = True) -> Manifest:
    """Makes the shards of ``plan`` that its folder does not hold yet.

    Args:
        plan: what to make.
        workers: processes (joblib's ``n_jobs``, so -1 is one per core); None leaves it to the surrounding
            ``joblib.parallel_config``.
        progress: show a bar in scenes.

    Raises:
        InputError: the folder holds other scenes (the first differing setting is named) or foreign shards, or a shard
            made again differs from the one the manifest tells of.
        OSError: no space, no permission; finished shards stay, nothing half-written does.
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
    """Makes sure the folder is this plan's, and returns the shards that it says were finished, by number."""
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
                    f"{plan.folder} holds scenes made with {field} = {old!r}, not {new!r}; "
                    "use the same settings or another folder."
                )
            if name == MANIFEST_NAME:
                return dict(enumerate(Manifest.load(plan.folder).shards))
            return _read_notes(plan)
    if any(plan.folder.glob("scenes-*.tar")):
        raise InputError(f"{plan.folder} holds shards but no {MANIFEST_NAME}; use an empty folder.")
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
            f"shard {folder / made.name} came out different from what was recorded before; the material or the program "
            "has changed, so make the scenes anew in another folder."
        )
    problem = shard_problem(folder, made, contents=False)
    if problem is not None:
        raise InputError(f"{problem} A worker wrote it just now: do all workers share this folder under this path?")


def _make(
    plan: GenerationPlan, missing: list[int], workers: int | None, progress: bool
) -> Iterator[tuple[int, ShardRecord]]:
    pickled = pickle.dumps(plan.simulator)
    # joblib keeps its processes, and they keep the working directory they were started in.
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
    # joblib's processes outlive a killed parent by all tasks that were queued, and would compete with its successor.
    if driver == _PARENT != os.getppid():
        os._exit(1)
    return scene


@functools.lru_cache(maxsize=1)
def _simulator(pickled: bytes) -> Simulator:
    """Kept from task to task, so that a worker loads its material once."""
    return pickle.loads(pickled)
