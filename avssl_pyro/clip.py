"""A clip, one second of audio with an image, and the labels of its scene, kept separately."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

SAMPLE_RATE = 16_000
CLIP_SAMPLES = SAMPLE_RATE
IMAGE_ROWS, IMAGE_COLUMNS = 88, 288
# The image covers elevations -55 to 55 degrees at 1.25 degrees a pixel, as the paper's 88 x 288 images do.
IMAGE_MAX_ELEVATION_DEG = 55.0


@dataclass(frozen=True)
class Clip:
    """One second of multichannel audio and a 360-degree image; the only input of training.

    Args:
        key: name of the clip, unique in its data set.
        audio_mn: audio, float32 in [-1, 1], (M, N), 16 kHz.
        image_ijc: image, uint8 RGB, (88, 288, 3), equirectangular; azimuth 0 in the middle, +180 degrees at the left.

    >>> Clip.from_audio("silence", np.zeros((4, 16_000), np.float32)).image_ijc.shape
    (88, 288, 3)
    """

    key: str
    audio_mn: npt.NDArray[np.float32]
    image_ijc: npt.NDArray[np.uint8]

    @classmethod
    def from_audio(cls, key: str, audio_mn: npt.NDArray[np.float32]) -> "Clip":
        """Returns a clip with a black image, for audio-only localization."""
        return cls(key, audio_mn, np.zeros((IMAGE_ROWS, IMAGE_COLUMNS, 3), np.uint8))


@dataclass(frozen=True)
class SceneLabels:
    """True azimuths of a scene, simulated or labelled by hand; used by evaluation only.

    Args:
        talker_azimuths: azimuths of talkers, radians.
        silent_azimuths: azimuths of silent people, radians.
    """

    talker_azimuths: tuple[float, ...]
    silent_azimuths: tuple[float, ...] = ()


def is_silent(audio_mn: npt.NDArray[np.float32]) -> bool:
    """Whether every channel of audio (M, N) is constant."""
    # Direct current is no sound; its spectrum beside 0 Hz is rounding, alike in all channels as a source would be.
    return not np.ptp(audio_mn, axis=-1).any()
