"""From a scene simulator to a plan for a dataset, with settings that tell whether two datasets would be the same."""

import hashlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

from avssl_pyro.datasets.generation import SCENES_PER_SHARD, GenerationPlan
from avssl_pyro.simulation.panoramas import PanoramaSource
from avssl_pyro.simulation.people import PersonSource
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.simulation.speech import SpeechSource


def plan_scenes(
    folder: Path, simulator: SceneSimulator, num_scenes: int, scenes_per_shard: int = SCENES_PER_SHARD
) -> GenerationPlan:
    """Plans the first ``num_scenes`` scenes of ``simulator``.

    Material is identified by the names and sizes of its files, so the same folder may lie in another place.
    """
    configuration = {
        "scene": asdict(simulator.config),
        "material": {
            "speech": material_identity(simulator.speech),
            "people": material_identity(simulator.people),
            "panoramas": material_identity(simulator.panoramas),
        },
    }
    return GenerationPlan(
        folder, simulator, configuration, simulator.seed, simulator.array, num_scenes, scenes_per_shard
    )


def material_identity(source: SpeechSource | PersonSource | PanoramaSource) -> dict[str, Any]:
    """What the manifest says of a source: its name, or the number of its files and a digest of names and sizes."""
    paths: tuple[Path, ...] | None = getattr(source, "paths", None)
    folder: Path | None = getattr(source, "folder", None)
    if paths is None or folder is None:
        return {"name": source.name}
    digest = hashlib.sha256()
    for path in paths:
        digest.update(f"{path.relative_to(folder).as_posix()}\0{path.stat().st_size}\0".encode())
    return {"name": "folder", "files": len(paths), "digest": digest.hexdigest()[:16]}
