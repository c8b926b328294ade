"""What a scene is on its way through the program: a clip to learn from, and labels kept apart from it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

SAMPLE_RATE = 16_000
CLIP_SAMPLES = SAMPLE_RATE
IMAGE_ROWS, IMAGE_COLUMNS = 88, 288
# The image keeps elevations -55..55 degrees at 1.25 degrees a pixel, as in the paper's 88 x 288 images.
IMAGE_MAX_ELEVATION_DEG = 55.0


@dataclass(frozen=True)
class Clip:
    """One second of multichannel audio and the 360-degree image taken with it; all that training ever sees.

    Args:
        key: name of the clip, unique in its data set.
        audio_mn: float32 in [-1, 1], (M, N), 16 kHz.
        image_ijc: uint8 RGB, (88, 288, 3), equirectangular, centre column straight ahead, left edge at +180 degrees.

    >>> Clip.without_picture("silence", np.zeros((4, 16_000), np.float32)).image_ijc.shape
    (88, 288, 3)
    """

    key: str
    audio_mn: npt.NDArray[np.float32]
    image_ijc: npt.NDArray[np.uint8]

    @classmethod
    def without_picture(cls, key: str, audio_mn: npt.NDArray[np.float32]) -> "Clip":
        """A clip for who only listens: its picture is black."""
        return cls(key, audio_mn, np.zeros((IMAGE_ROWS, IMAGE_COLUMNS, 3), np.uint8))


@dataclass(frozen=True)
class SceneLabels:
    """The truth about a scene, simulated or labelled by hand; read by evaluation only.

    Args:
        talker_azimuths: azimuths of the people who speak, radians.
        silent_azimuths: azimuths of the people who do not, radians.
    """

    talker_azimuths: tuple[float, ...]
    silent_azimuths: tuple[float, ...] = ()
