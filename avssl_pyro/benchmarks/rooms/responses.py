"""Measured impulse responses of rooms, from a folder of WAV, FLAC and SOFA files with their directions."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import check_channels
from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.acoustics.sofa import read_sofa_impulses
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.errors import InputError
from avssl_pyro.io.audio import AudioFile, check_live, resample
from avssl_pyro.io.csv_table import CsvLine, read_csv_table
from avssl_pyro.recordings.labeled_recordings import LABELS_NAME

SOFA_SUFFIX = ".sofa"
# Measurements of a SOFA file further from the horizontal plane are left out.
MAX_ELEVATION_DEG = 15.0
MAX_RESPONSE_S = 10.0
# The direct sound begins where a channel first comes within 20 dB of its maximum, as in ISO 3382.
ONSET = 0.1
BEFORE_DIRECT = SAMPLE_RATE // 200
EARLY = 30 * SAMPLE_RATE // 1000


@dataclass(frozen=True, eq=False)
class RoomResponse:
    """A measured response from one place to every microphone of an array.

    Args:
        name: file relative to the folder, and the measurement in it.
        where: the same with the path, for messages.
        setting: room and its state; a clip has responses of one setting.
        azimuth: direction of the loudspeaker, radians counter-clockwise from the array's x axis.
        distance_m: distance of the loudspeaker in metres, or None.
        samples: audio file, or samples of all channels at 16 kHz, (channels, N).
        channels: channel of each microphone, counted from 0.
    """

    name: str
    where: str
    setting: str
    azimuth: float
    distance_m: float | None
    samples: AudioFile | npt.NDArray[np.float32]
    channels: tuple[int, ...]

    def impulse_mn(self) -> npt.NDArray[np.float64]:
        """Impulse response of every microphone, (M, N), 16 kHz, from 5 ms before the direct sound.

        Raises:
            InputError: the file is damaged, or a microphone has no response.
        """
        samples = self.samples
        whole_mn = samples.read_samples(0, samples.num_samples) if isinstance(samples, AudioFile) else samples
        impulse_mn = whole_mn[list(self.channels)]
        if not impulse_mn.any():
            raise InputError(f"{self.where}: is silent throughout; give a measured response.")
        check_live(impulse_mn, self.where, self.channels)
        return impulse_mn[:, max(0, direct_sound(impulse_mn) - BEFORE_DIRECT) :].astype(np.float64)

    def late_mn(self) -> npt.NDArray[np.float64]:
        """The impulse response without the first 30 ms after the direct sound, (M, N).

        Raises:
            InputError: as of :meth:`impulse_mn`, or nothing is left.
        """
        impulse_mn = self.impulse_mn()
        impulse_mn[:, : direct_sound(impulse_mn) + EARLY] = 0
        if not impulse_mn.any():
            raise InputError(
                f"{self.where}: ends within 30 ms of its direct sound; diffuse noise needs the response of a room."
            )
        return impulse_mn


def direct_sound(impulse_mn: npt.NDArray[np.floating]) -> int:
    """The sample at which the direct sound reaches the first microphone."""
    share_mn = np.abs(impulse_mn) / np.abs(impulse_mn).max(axis=1, keepdims=True)
    return int((share_mn >= ONSET).any(axis=0).argmax())


def read_responses(folder: Path, array: MicrophoneArray) -> tuple[RoomResponse, ...]:
    """Reads ``labels.csv`` of a folder and returns its responses in the order of the lines.

    Column ``file`` names WAV, FLAC or SOFA files relative to the folder, and ``azimuth_deg`` their directions. Where
    ``azimuth_deg`` is empty, a SOFA file gives all its measurements near the horizontal plane with its own directions.
    Columns ``room``, ``setting`` and ``distance_m`` are optional.

    Raises:
        InputError: the folder, the list or a file is missing or invalid; the message names the line.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of room responses.")
    table = read_csv_table(folder / LABELS_NAME, ("file", "azimuth_deg"))
    listed: dict[str, str] = {}
    responses: list[RoomResponse] = []
    for line in table.lines:
        name = line.file_name("file")
        if name in listed:
            raise InputError(f"{line.where}: {name} is listed above already; give each file one line.")
        listed[name] = line.where
        responses += _responses_of_line(folder / name, line, array)
    return tuple(responses)


def _responses_of_line(path: Path, line: CsvLine, array: MicrophoneArray) -> list[RoomResponse]:
    setting = " ".join(filter(None, (line.cells.get("room"), line.cells.get("setting"))))
    distance_m = _number(line, "distance_m", "metres above 0", 0.0, math.inf)
    azimuth_deg = _number(line, "azimuth_deg", "degrees from -360 to 360", -360.0, 360.0)
    channels = array.channel_indices
    if distance_m == 0:
        raise InputError(f"{line.where}: distance_m is 0; give metres above 0, or leave it empty.")
    if not path.is_file():
        raise InputError(f"{line.where}: there is no file {path}; names are relative to the folder of the list.")
    if path.suffix.lower() == SOFA_SUFFIX:
        return _of_sofa(path, line, array, setting, azimuth_deg, distance_m)
    if azimuth_deg is None:
        raise InputError(f"{line.where}: azimuth_deg is empty; give the loudspeaker's azimuth in degrees.")
    audio = AudioFile(path)
    check_channels(audio.num_channels, array, str(path))
    _check_duration(audio.duration_s, path)
    return [
        RoomResponse(line.file_name("file"), str(path), setting, _wrapped(azimuth_deg), distance_m, audio, channels)
    ]


def _of_sofa(
    path: Path,
    line: CsvLine,
    array: MicrophoneArray,
    setting: str,
    azimuth_deg: float | None,
    distance_m: float | None,
) -> list[RoomResponse]:
    sofa = read_sofa_impulses(path)
    count, receivers, length = sofa.impulse_dmn.shape
    check_channels(receivers, array, str(path))
    _check_duration(length / sofa.sample_rate, path)
    if azimuth_deg is not None and count > 1:
        raise InputError(
            f"{line.where}: azimuth_deg is {azimuth_deg:g}, but {path} has {count} measurements; leave azimuth_deg "
            "empty, and the file's own directions are used."
        )
    near_d = np.abs(sofa.elevations_d) <= np.deg2rad(MAX_ELEVATION_DEG) + 1e-9
    chosen = [0] if azimuth_deg is not None else np.flatnonzero(near_d).tolist()
    if not chosen:
        raise InputError(
            f"{path}: has no source within {MAX_ELEVATION_DEG:g} degrees of the horizontal plane; give one that has."
        )
    return [
        RoomResponse(
            f"{line.file_name('file')}, measurement {d + 1}",
            f"{path}, measurement {d + 1}",
            setting,
            float(sofa.azimuths_d[d]) if azimuth_deg is None else _wrapped(azimuth_deg),
            distance_m,
            resample(sofa.impulse_dmn[d].astype(np.float32), sofa.sample_rate, axis=-1),
            array.channel_indices,
        )
        for d in chosen
    ]


def _number(line: CsvLine, column: str, wanted: str, low: float, high: float) -> float | None:
    """The number in a column, None where it is empty or missing."""
    text = (line.cells.get(column) or "").strip()
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(f"{line.where}: {column} holds '{text}'; give {wanted}.")
    return value


def _wrapped(azimuth_deg: float) -> float:
    return float(wrap_angle(np.deg2rad(azimuth_deg)))


def _check_duration(seconds: float, path: Path) -> None:
    if seconds > MAX_RESPONSE_S:
        raise InputError(
            f"{path}: lasts {seconds:.1f} s; an impulse response lasts up to {MAX_RESPONSE_S:g} s, so give responses "
            "and not recordings."
        )
