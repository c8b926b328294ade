"""File formats of a scene: audio as FLAC or WAV, image as JPEG, labels and metadata as JSON in degrees.

16-bit FLAC has 0.6 times the size of 24-bit FLAC; its quantization noise is about 40 dB below the noise of a scene.
JPEG at quality 95 without chroma subsampling has a third of the size and half the decoding time of PNG.
"""

import io
import json
import math
import re
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt
import soundfile

from avssl_pyro.clip import IMAGE_COLUMNS, IMAGE_ROWS, SAMPLE_RATE, Clip, SceneLabels
from avssl_pyro.errors import InputError

FLAC_MAX_CHANNELS = 8
AUDIO_EXTENSIONS = ("flac", "wav")
IMAGE_EXTENSION = "jpg"
METADATA_EXTENSION = "json"

_FULL_SCALE = 32768.0
_FLAC_COMPRESSION = 0.0
_JPEG_SETTINGS = (
    cv2.IMWRITE_JPEG_QUALITY,
    95,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    cv2.IMWRITE_JPEG_OPTIMIZE,
    0,
)
_KEY = re.compile(r"[A-Za-z0-9_-]+")


# Clips below this level are stored with 24 bits, so that rounding stays far below their noise.
_QUIET_RMS = 3e-3


class Scene(Protocol):
    """A clip to be stored, its labels or None, and metadata (plain JSON values; degrees, metres)."""

    @property
    def clip(self) -> Clip: ...
    @property
    def labels(self) -> SceneLabels | None: ...
    @property
    def metadata(self) -> dict[str, Any]: ...


class LabeledScene(Scene, Protocol):
    """A scene that has labels."""

    @property
    def labels(self) -> SceneLabels: ...


def encode_scene(scene: Scene) -> dict[str, bytes]:
    """Encodes a scene as file contents by extension, in stored order.

    Raises:
        InputError: the key is no plain file name, the audio is not finite, or the image has another shape.
    """
    key = scene.clip.key
    if not _KEY.fullmatch(key):
        raise InputError(f"scene '{key}': the key is a file name and may contain only letters, digits, '-' and '_'.")
    return (
        _encode_audio(scene.clip.audio_mn, where=f"scene '{key}'")
        | {IMAGE_EXTENSION: _encode_image(scene.clip.image_ijc, where=f"scene '{key}'")}
        | {METADATA_EXTENSION: _encode_metadata(scene)}
    )


def _encode_audio(audio_mn: npt.NDArray[np.float32], where: str) -> dict[str, bytes]:
    if audio_mn.ndim != 2 or not np.isfinite(audio_mn).all():
        raise InputError(f"{where}: the audio must have shape (microphones, samples) and finite values.")
    # The variance leaves out the offset of the converters.
    quiet = float(audio_mn.var(axis=1, dtype=np.float64).mean()) < _QUIET_RMS**2
    scale, subtype = (_FULL_SCALE * 256.0, "PCM_24") if quiet else (_FULL_SCALE, "PCM_16")
    # Rounded here: libsndfile scales floats by 32767 on the way in and by 32768 on the way out.
    rounded_mn = np.clip(np.rint(audio_mn * scale), -scale, scale - 1)
    # libsndfile takes the upper 24 of 32 bits.
    pcm_mn = rounded_mn.astype(np.int32) * 256 if quiet else rounded_mn.astype(np.int16)
    stream = io.BytesIO()
    if len(pcm_mn) > FLAC_MAX_CHANNELS:
        soundfile.write(stream, pcm_mn.T, SAMPLE_RATE, format="WAV", subtype=subtype)
        return {"wav": stream.getvalue()}
    soundfile.write(stream, pcm_mn.T, SAMPLE_RATE, format="FLAC", subtype=subtype, compression_level=_FLAC_COMPRESSION)
    return {"flac": stream.getvalue()}


def decode_audio(content: bytes, where: str) -> npt.NDArray[np.float32]:
    """Decodes the audio of a stored scene, (M, N), float32 in [-1, 1].

    Raises:
        InputError: the audio cannot be decoded or is not sampled at 16 kHz.
    """
    try:
        audio_nm, sample_rate = soundfile.read(io.BytesIO(content), dtype="float32", always_2d=True)
    except soundfile.SoundFileError as error:
        raise InputError(f"{where}: the audio cannot be decoded ({error}); make the scenes again.") from error
    if sample_rate != SAMPLE_RATE:
        raise InputError(f"{where}: the audio has {sample_rate} Hz; scenes are stored at {SAMPLE_RATE} Hz.")
    return audio_nm.T


def _encode_image(image_ijc: npt.NDArray[np.uint8], where: str) -> bytes:
    if image_ijc.shape != (IMAGE_ROWS, IMAGE_COLUMNS, 3) or image_ijc.dtype != np.uint8:
        raise InputError(
            f"{where}: the image has shape {image_ijc.shape}; give uint8 ({IMAGE_ROWS}, {IMAGE_COLUMNS}, 3)."
        )
    _, encoded = cv2.imencode(f".{IMAGE_EXTENSION}", cv2.cvtColor(image_ijc, cv2.COLOR_RGB2BGR), _JPEG_SETTINGS)
    return encoded.tobytes()


def decode_image(content: bytes, where: str) -> npt.NDArray[np.uint8]:
    """Decodes the image of a stored scene, uint8 RGB, (88, 288, 3).

    Raises:
        InputError: the image cannot be decoded or has another size.
    """
    decoded = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR) if content else None
    if decoded is None or decoded.shape != (IMAGE_ROWS, IMAGE_COLUMNS, 3):
        found = "cannot be decoded" if decoded is None else f"has {decoded.shape[0]} x {decoded.shape[1]} pixels"
        raise InputError(f"{where}: the image {found}; scenes have JPEGs of {IMAGE_ROWS} x {IMAGE_COLUMNS}.")
    return cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB)  # type: ignore[return-value]


def _encode_metadata(scene: Scene) -> bytes:
    labels = scene.labels
    content = {
        "key": scene.clip.key,
        "talker_azimuths_deg": None if labels is None else _degrees(labels.talker_azimuths),
        "silent_azimuths_deg": None if labels is None else _degrees(labels.silent_azimuths),
        "facts": scene.metadata,
    }
    return json.dumps(content, indent=1, sort_keys=True, allow_nan=False).encode()


def _degrees(azimuths: tuple[float, ...]) -> list[float]:
    return [round(math.degrees(azimuth), 9) for azimuth in azimuths]


def decode_metadata(content: bytes, where: str) -> tuple[SceneLabels | None, dict[str, Any]]:
    """Decodes labels (radians, or None) and metadata of a stored scene.

    Raises:
        InputError: the content does not have the format of :func:`encode_scene`.
    """
    try:
        data = json.loads(content)
        if data["talker_azimuths_deg"] is None:
            return None, dict(data["facts"])
        labels = SceneLabels(
            talker_azimuths=tuple(math.radians(azimuth) for azimuth in data["talker_azimuths_deg"]),
            silent_azimuths=tuple(math.radians(azimuth) for azimuth in data["silent_azimuths_deg"]),
        )
        return labels, dict(data["facts"])
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(f"{where}: the JSON is damaged ({type(error).__name__}: {error}).") from error
