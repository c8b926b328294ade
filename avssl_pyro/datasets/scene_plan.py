"""Generation plan of a scene simulator, with settings that are equal for equal data sets."""

import hashlib
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

    Assets are identified by the names and sizes of their files, so that their folder may be moved.
    """
    configuration = {
        "scene": simulator.config.to_dict(),
        "material": {
            "speech": asset_identity(simulator.speech),
            "people": asset_identity(simulator.people),
            "panoramas": asset_identity(simulator.panoramas),
        },
    }
    return GenerationPlan(
        folder, simulator, configuration, simulator.seed, simulator.array, num_scenes, scenes_per_shard
    )


def asset_identity(source: SpeechSource | PersonSource | PanoramaSource) -> dict[str, Any]:
    """Returns the manifest's entry for a source: its name, or number of files and digest of names and sizes."""
    paths: tuple[Path, ...] | None = getattr(source, "paths", None)
    folder: Path | None = getattr(source, "folder", None)
    if paths is None or folder is None:
        return {"name": source.name}
    digest = hashlib.sha256()
    for path in paths:
        digest.update(f"{path.relative_to(folder).as_posix()}\0{path.stat().st_size}\0".encode())
    return {"name": "folder", "files": len(paths), "digest": digest.hexdigest()[:16]}
