"""The data sets that commands fall back on: scenes made in code, rendered once and kept in a cache folder."""

from dataclasses import dataclass, replace
from pathlib import Path

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import matching_channels
from avssl_pyro.datasets.cache import ensure_dataset
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.scene_plan import plan_scenes
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.layout import CONDITIONS, SceneConfig
from avssl_pyro.simulation.scenes import SceneSimulator


@dataclass(frozen=True)
class Split:
    """A part of the data with scenes of its own.

    Args:
        name: appears in the folder's name.
        seed: of the scenes; every split has another, and one that nobody types at simulate.py by chance.
    """

    name: str
    seed: int


TRAIN, VALIDATION, TEST = Split("train", 20201001), Split("validation", 20201002), Split("test", 20201003)


def default_dataset(
    cache: Path, split: Split, condition: str, num_scenes: int, array: MicrophoneArray, progress: bool = True
) -> SceneDataset:
    """Makes or reopens the embedded scenes of a split, read as ``array``.

    The union of the paper's circles is rendered whenever ``array`` is part of it, so that its sub-arrays share files.
    """
    simulator = SceneSimulator(replace(SceneConfig(), condition=CONDITIONS[condition]), seed=split.seed)
    name = f"{condition}-{split.name}-{num_scenes}"
    try:
        matching_channels(simulator.array, array, where="the default scenes")
    except InputError:
        simulator = replace(simulator, array=array)
        name = f"{name}-{array.name}"
    return ensure_dataset(plan_scenes(cache / name, simulator, num_scenes), workers=-1, array=array, progress=progress)
