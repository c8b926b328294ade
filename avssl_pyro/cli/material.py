"""The folders of material that simulations take, as options of commands."""

from dataclasses import dataclass, replace
from pathlib import Path

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.simulation.camera import Camera
from avssl_pyro.simulation.moving_people import MovingPeopleConfig
from avssl_pyro.simulation.panoramas import PanoramaFolder, PanoramaSource
from avssl_pyro.simulation.people import PeopleFolder, PersonSource
from avssl_pyro.simulation.recordings import RecordingSimulator
from avssl_pyro.simulation.speech import SpeechFolder, SpeechSource
from avssl_pyro.simulation.synthetic_people import ProceduralPerson
from avssl_pyro.simulation.synthetic_rooms import ProceduralRoom
from avssl_pyro.simulation.synthetic_speech import ProceduralSpeech


@dataclass(frozen=True)
class AssetOptions:
    """Folders of material; what is made in code stands in for a missing one."""

    speech: Path | None = None
    """Folder of speech files: WAV or FLAC, any rate."""
    people: Path | None = None
    """Folder of cut-outs of people: RGBA PNG, feet at the bottom."""
    panoramas: Path | None = None
    """Folder of rooms: equirectangular JPEG or PNG, twice as wide as high."""

    def speech_source(self) -> SpeechSource:
        return ProceduralSpeech() if self.speech is None else SpeechFolder(self.speech)

    def person_source(self) -> PersonSource:
        return ProceduralPerson() if self.people is None else PeopleFolder(self.people)

    def panorama_source(self) -> PanoramaSource:
        return ProceduralRoom() if self.panoramas is None else PanoramaFolder(self.panoramas)

    def recording_simulator(
        self, config: MovingPeopleConfig, seconds: float, seed: int, array: MicrophoneArray, camera: Camera
    ) -> RecordingSimulator:
        """Recordings of this material, of whole frames of their labels."""
        return RecordingSimulator(
            config=replace(config, walks=replace(config.walks, seconds=round(seconds, 1))),
            seed=seed,
            array=array,
            camera=camera,
            speech=self.speech_source(),
            people=self.person_source(),
            panoramas=self.panorama_source(),
        )
