"""Files of simulated recordings, named, laid out and encoded as in STARSS23."""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import soundfile
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.steering_kinds import AmbisonicsKind
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.io.audio import resample
from avssl_pyro.io.dcase import write_dcase
from avssl_pyro.io.video_writer import open_video
from avssl_pyro.recordings.starss23 import StarssFiles
from avssl_pyro.simulation.recordings import SimulatedRecording

# Folds of these splits in STARSS23, by which its file names begin.
FOLDS = {"dev-train": 3, "dev-test": 4}
SOURCE = "simulated"


@dataclass(frozen=True)
class StarssWriter:
    """Writer of simulated recordings.

    Args:
        root: folder that receives mic_dev or foa_dev, video_dev and metadata_dev.
        split: split of the recordings, "dev-train" or "dev-test".
        sample_rate: sample rate of the audio, hertz.
        frame_rate: frame rate of the video, hertz.
    """

    root: Path
    split: str = "dev-test"
    sample_rate: int = 24_000
    frame_rate: float = 30_000 / 1001

    def write(self, recording: SimulatedRecording, index: int, progress: bool = False) -> StarssFiles:
        """Renders and writes a recording, and returns its files.

        Args:
            recording: recording whose sound and picture have not been rendered yet; its seed is the number of the room.
            index: index of the recording, counted from 0.
            progress: show a progress bar of the video.

        Raises:
            OSError: a file cannot be written.
        """
        fold, room, mix = FOLDS[self.split], recording.simulator.seed, index + 1
        name = f"fold{fold}_room{room}_mix{mix:03d}"
        array = recording.simulator.array
        audio_format = "foa" if isinstance(array.steering, AmbisonicsKind) else "mic"
        folder = f"{self.split}-{SOURCE}"
        audio = self.root / f"{audio_format}_dev" / folder / f"{name}.wav"
        labels = self.root / "metadata_dev" / folder / f"{name}.csv"
        video = self.root / "video_dev" / folder / f"{name}.mp4"
        for path in (audio, labels, video):
            path.parent.mkdir(parents=True, exist_ok=True)
        _write_audio(audio, recording.render_audio(), array, self.sample_rate)
        write_dcase(labels, recording.labels)
        _write_video(video, recording, self.frame_rate, progress)
        return StarssFiles(name, fold, room, mix, audio, video, labels)


def _write_audio(path: Path, audio_mn: npt.NDArray[np.float32], array: MicrophoneArray, rate: int) -> None:
    """Writes 16-bit audio on the channels of the array; other channels are silent."""
    audio_mn = resample(audio_mn, SAMPLE_RATE, axis=-1, new_rate=rate)
    channels_cn = np.zeros((max(array.channel_indices) + 1, audio_mn.shape[1]), dtype=np.float32)
    channels_cn[list(array.channel_indices)] = audio_mn
    buffer = io.BytesIO()
    soundfile.write(buffer, channels_cn.T, rate, format="WAV", subtype="PCM_16")
    write_atomically(path, buffer.getvalue())


def _write_video(path: Path, recording: SimulatedRecording, frame_rate: float, progress: bool) -> None:
    width = recording.simulator.camera.columns
    frames = recording.render_video()
    num_frames = round(recording.seconds * frame_rate)
    with open_video(path, width, width // 2, frame_rate) as writer:
        for number in tqdm(range(num_frames), unit="frame", desc=path.stem, disable=not progress):
            writer.write(frames.frame_at(number / frame_rate), number / frame_rate)
