"""Simulation of labelled scenes in one call."""

from pathlib import Path
from typing import Literal

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.generation import SCENES_PER_SHARD, generate
from avssl_pyro.datasets.scene_plan import plan_scenes
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.panoramas import PanoramaFolder
from avssl_pyro.simulation.people import PeopleFolder
from avssl_pyro.simulation.scene_config import SCENE_CONFIGS
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.simulation.speech import SpeechFolder
from avssl_pyro.simulation.synthetic.people import ProceduralPerson
from avssl_pyro.simulation.synthetic.rooms import ProceduralRoom
from avssl_pyro.simulation.synthetic.speech import ProceduralSpeech


def simulate(
    out: str | Path,
    scenes: int = 200,
    *,
    condition: Literal["all-speak", "some-silent", "wide"] = "some-silent",
    array: str | Path | MicrophoneArray = "circle246",
    seed: int = 0,
    speech: str | Path | None = None,
    people: str | Path | None = None,
    panoramas: str | Path | None = None,
    workers: int = -1,
    progress: bool = False,
) -> SceneDataset:
    """Renders labelled audio-visual scenes into a folder of shards; stopped at any moment, the same call goes on.

    Args:
        out: folder, made if it does not exist.
        scenes: number of scenes.
        condition: "all-speak", "some-silent" with people who do not speak, or "wide" with varied rooms and noise.
        array: microphones by preset, file or object; "circle246" can be read as circle2, circle4 or circle6 later.
        seed: seed of the scenes; the same seed gives the same bytes.
        speech, people, panoramas: folders of assets; assets made in code stand in for missing ones.
        workers: number of processes; -1 is one per core.
        progress: show a progress bar.

    Returns:
        The scenes as a data set of clips.

    Raises:
        InputError: a number is out of range, assets are missing, or the folder holds other scenes.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     scenes = simulate(folder, 1, array="circle4", workers=1)
    ...     scenes[0].audio_mn.shape
    (4, 16000)
    """
    if condition not in SCENE_CONFIGS:
        raise InputError(f"simulate: condition is '{condition}'; give one of {', '.join(SCENE_CONFIGS)}.")
    if scenes < 1 or seed < 0:
        raise InputError(
            f"simulate: scenes is {scenes} and seed {seed}; give at least 1 scene and a seed of at least 0."
        )
    if workers < 1 and workers != -1:
        raise InputError(f"simulate: workers is {workers}; give at least 1, or -1 for one per core.")
    out = Path(out)
    simulator = SceneSimulator(
        config=SCENE_CONFIGS[condition],
        seed=seed,
        speech=ProceduralSpeech() if speech is None else SpeechFolder(Path(speech)),
        people=ProceduralPerson() if people is None else PeopleFolder(Path(people)),
        panoramas=ProceduralRoom() if panoramas is None else PanoramaFolder(Path(panoramas)),
        array=resolve_array(array),
    )
    generate(plan_scenes(out, simulator, scenes, SCENES_PER_SHARD), workers, progress)
    return SceneDataset(out)
