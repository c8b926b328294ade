"""Default data sets of commands: simulated scenes, rendered once into a cache folder."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import matching_channels
from avssl_pyro.datasets.dataset import LabeledClips, SceneDataset
from avssl_pyro.datasets.generation import GenerationPlan, generate
from avssl_pyro.datasets.scene_plan import plan_scenes
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.scene_config import SCENE_CONFIGS
from avssl_pyro.simulation.scenes import SceneSimulator


@dataclass(frozen=True)
class Split:
    """A part of the data; no two splits have a scene in common.

    Args:
        name: part of the folder's name.
        seed: seed of the scenes, different for every split and unlikely to be chosen by a user.
    """

    name: str
    seed: int


TRAIN, VALIDATION, TEST = Split("train", 20201001), Split("validation", 20201002), Split("test", 20201003)


def default_dataset(
    cache: Path, split: Split, condition: str, num_scenes: int, array: MicrophoneArray, progress: bool = True
) -> SceneDataset:
    """Opens the default scenes of a split as ``array``, and renders missing ones.

    If ``array`` is part of the union of the paper's circles, the union is rendered, so that its sub-arrays share files.
    """
    simulator = SceneSimulator(SCENE_CONFIGS[condition], seed=split.seed)
    name = f"{condition}-{split.name}-{num_scenes}"
    try:
        matching_channels(simulator.array, array, where="the default scenes")
    except InputError:
        simulator = replace(simulator, array=array)
        name = f"{name}-{array.name}"
    return ensure_dataset(plan_scenes(cache / name, simulator, num_scenes), workers=-1, array=array, progress=progress)


def ensure_dataset(
    plan: GenerationPlan, workers: int | None = None, array: MicrophoneArray | None = None, progress: bool = True
) -> SceneDataset:
    """Opens the dataset of ``plan`` as ``array``, after rendering what is missing.

    If several processes call this at once, one renders and the others wait.

    Raises:
        InputError, OSError: see :func:`generate` and :class:`SceneDataset`.
    """
    generate(plan, workers, progress)
    return SceneDataset(plan.folder, array)


def open_scenes(
    folders: Sequence[Path], array: MicrophoneArray, cache: Path, split: Split, condition: str, num_scenes: int
) -> LabeledClips:
    """Scenes of the given folders, or without any the embedded ones of a split and condition.

    Args:
        folders: folders of shards.
        array: microphones to read.
        cache: folder of the embedded scenes.
        split, condition, num_scenes: selection of the embedded scenes.
    """
    if folders:
        return LabeledClips(SceneDataset(folders, array))
    return LabeledClips(default_dataset(cache, split, condition, num_scenes, array))
