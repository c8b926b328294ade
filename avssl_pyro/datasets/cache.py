"""A dataset that is made when it is first asked for."""

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.generation import GenerationPlan, generate


def ensure_dataset(
    plan: GenerationPlan, workers: int | None = None, array: MicrophoneArray | None = None, progress: bool = True
) -> SceneDataset:
    """Makes or completes the dataset of ``plan``, unless it is there already, and opens it as ``array``.

    Several processes may call this at once: one of them works, the others wait.

    Raises:
        InputError, OSError: see :func:`generate` and :class:`SceneDataset`.
    """
    generate(plan, workers, progress)
    return SceneDataset(plan.folder, array)
