"""A user's own picture and recording as a clip."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import soundfile
from scipy.signal import resample_poly

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.clip import IMAGE_COLUMNS, IMAGE_MAX_ELEVATION_DEG, IMAGE_ROWS, SAMPLE_RATE, Clip
from avssl_pyro.errors import InputError
from avssl_pyro.io.audio_stream import check_live, check_samples
from avssl_pyro.io.projection_check import check_equirectangular

MAX_SECONDS = 10.0
MIN_SECONDS = 0.1


def read_audio(path: Path, array: MicrophoneArray) -> npt.NDArray[np.float32]:
    """Reads the array's channels of a WAV or FLAC file of any rate as float32 (M, N) at 16 kHz.

    Raises:
        InputError: the file cannot be read, has the wrong number of channels, is too short or too long, or holds
            samples that are not finite, or is silent in some channels alone.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such audio file.")
    try:
        with soundfile.SoundFile(path) as file:
            rate = file.samplerate
            check_channels(file.channels, array, str(path))
            _check_duration(file.frames, rate, str(path))
            audio_nm = file.read(dtype="float32", always_2d=True)
    except (soundfile.SoundFileError, RuntimeError) as error:
        raise InputError(f"{path}: cannot be read as audio ({error}); give WAV or FLAC.") from error
    return fit_audio(audio_nm, rate, array, str(path))


def fit_audio(
    audio_nm: npt.NDArray[np.float32], rate: int, array: MicrophoneArray, where: str
) -> npt.NDArray[np.float32]:
    """Samples of the array's microphones in its order, float32 (M, N) at 16 kHz.

    Args:
        audio_nm: samples of all channels, (N, channels).
        rate: sample rate in Hz.
        array: microphones and the channels they are on.
        where: name of the recording in error messages.

    Raises:
        InputError: the number of channels is wrong, the clip is too short or too long, samples are not finite, or some
            channels alone are silent.
    """
    check_channels(audio_nm.shape[1], array, where)
    _check_duration(len(audio_nm), rate, where)
    audio_nm = audio_nm[:, list(array.channel_indices)]
    check_samples(audio_nm, where, channels=array.channel_indices)
    check_live(audio_nm.T, where, array.channel_indices)
    if rate != SAMPLE_RATE:
        divisor = int(np.gcd(rate, SAMPLE_RATE))
        audio_nm = resample_poly(audio_nm, SAMPLE_RATE // divisor, rate // divisor, axis=0)
    return np.ascontiguousarray(audio_nm.T, dtype=np.float32)


def _check_duration(frames: int, rate: int, where: str) -> None:
    if frames > MAX_SECONDS * rate:
        raise InputError(
            f"{where}: {frames / rate:.1f} s long; a clip may last up to {MAX_SECONDS:g} s, so cut out a part "
            "during which nobody moves."
        )
    if frames < MIN_SECONDS * rate:
        raise InputError(
            f"{where}: {frames} samples ({1e3 * frames / rate:.0f} ms); a clip needs at least "
            f"{1e3 * MIN_SECONDS:.0f} ms."
        )


def check_channels(found: int, array: MicrophoneArray, where: str) -> None:
    """Refuses a recording that lacks channels of the array, or has others that no channel map leaves out.

    Raises:
        InputError: the array has no channel map and the numbers differ, or a channel of the map does not exist.
    """
    if array.channels is None and found != array.num_microphones:
        raise InputError(
            f"{where}: {found} channel(s), but array '{array.name}' has {array.num_microphones} microphones; give a "
            "recording of that array, one channel per microphone, or say in the array's file under 'channels' which "
            "are its own."
        )
    if array.channels is not None and found < max(array.channels):
        microphone = array.channels.index(max(array.channels)) + 1
        raise InputError(
            f"{where}: {found} channel(s), but microphone {microphone} of array '{array.name}' is on channel "
            f"{max(array.channels)}; give a recording with all channels, or another channel map."
        )


def read_image(path: Path) -> npt.NDArray[np.uint8]:
    """Reads a full-sphere (2:1) or an 88 x 288 equirectangular image as uint8 RGB (88, 288, 3).

    Raises:
        InputError: the file cannot be read, has other proportions, or is of a fisheye lens.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such image file.")
    content = np.fromfile(path, dtype=np.uint8)
    image_ijc = cv2.imdecode(content, cv2.IMREAD_COLOR_RGB) if content.size else None
    if image_ijc is None:
        raise InputError(f"{path}: cannot be read as an image; give JPEG or PNG.")
    return fit_panorama(image_ijc.astype(np.uint8), str(path))


def fit_panorama(image_ijc: npt.NDArray[np.uint8], where: str) -> npt.NDArray[np.uint8]:
    """An image as :func:`fit_image` returns it, after a check that it is no fisheye's.

    Raises:
        InputError: the image has other proportions, or is of a fisheye lens.
    """
    fitted_ijc = fit_image(image_ijc, where)
    if is_full_sphere(image_ijc):
        check_equirectangular(image_ijc, where)
    return fitted_ijc


def is_full_sphere(image_ijc: npt.NDArray[np.generic]) -> bool:
    """Whether a picture is twice as wide as high."""
    rows, columns = image_ijc.shape[:2]
    return abs(columns - 2 * rows) <= 2


def fit_image(image_ijc: npt.NDArray[np.uint8], where: str) -> npt.NDArray[np.uint8]:
    """Crops a full sphere to elevations -55..55 degrees and scales it to 88 x 288.

    Raises:
        InputError: the image is neither a full sphere (twice as wide as high) nor has the proportions of 88 x 288.
    """
    rows, columns = image_ijc.shape[:2]
    if is_full_sphere(image_ijc):
        margin = round(rows * (90.0 - IMAGE_MAX_ELEVATION_DEG) / 180.0)
        image_ijc = image_ijc[margin : rows - margin]
    elif abs(columns * IMAGE_ROWS - rows * IMAGE_COLUMNS) > 2 * IMAGE_COLUMNS:
        raise InputError(
            f"{where}: {columns} x {rows} pixels; a 360-degree image is twice as wide as high (full sphere), or has "
            f"the proportions {IMAGE_COLUMNS} x {IMAGE_ROWS} (elevations -55 to 55 degrees)."
        )
    if columns < IMAGE_COLUMNS // 2:
        raise InputError(f"{where}: only {columns} pixels wide; give an image of at least {IMAGE_COLUMNS // 2}.")
    if image_ijc.shape[:2] == (IMAGE_ROWS, IMAGE_COLUMNS):
        return image_ijc
    shrinks = image_ijc.shape[1] >= IMAGE_COLUMNS
    resized = cv2.resize(
        image_ijc, (IMAGE_COLUMNS, IMAGE_ROWS), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    )
    return np.asarray(resized, dtype=np.uint8)


def read_clip(image: Path, audio: Path, array: MicrophoneArray) -> Clip:
    """A clip from an image and an audio file of the array; see :func:`read_image` and :func:`read_audio`."""
    return Clip(audio.stem, read_audio(audio, array), read_image(image))
