"""A microphone array: positions, channels and steering, their validation, and their YAML file."""

import math
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.steering import SteeringKind
from avssl_pyro.acoustics.steering_kinds import FreeFieldKind, steering_from_dict
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.errors import InputError

SPEED_OF_SOUND = 343.0
MAX_EXTENT_M = 5.0
MIN_SPACING_M = 1e-4


KEYS = ("name", "positions_m", "speed_of_sound", "channels", "steering")


@dataclass(frozen=True)
class MicrophoneArray:
    """M microphones with their positions, their steering model and their channels in a recording.

    Args:
        name: free text, shown in results.
        positions_m: M rows of (x, y, z) in metres; x forward, y left, z up, measured from the camera's axis. Empty for
            ambisonics, whose channels have no positions; optional for measured responses.
        speed_of_sound: speed of sound, metres per second.
        steering: steering model of the array, free field by default.
        channels: channel of each microphone in a recording, counted from 1 as on a recorder's labels. By default a
            recording has one channel per microphone, in order.

    Raises:
        InputError: there are fewer than two microphones, positions are not finite or equal, the array is wider than
            5 m, positions do not fit the steering model, or channels are not M different positive numbers.

    >>> corners = ((0.05, 0.05, 0.0), (-0.05, 0.05, 0.0), (-0.05, -0.05, 0.0), (0.05, -0.05, 0.0))
    >>> MicrophoneArray("square", corners).num_microphones
    4
    """

    name: str
    positions_m: tuple[tuple[float, float, float], ...] = ()
    speed_of_sound: float = SPEED_OF_SOUND
    steering: SteeringKind = field(default_factory=FreeFieldKind)
    channels: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        where = f"array '{self.name}'"
        for index, position in enumerate(self.positions_m, start=1):
            if len(position) != 3:
                raise InputError(
                    f"{where}: microphone {index} has {len(position)} coordinates; give x, y, z in metres."
                )
            if not np.isfinite(position).all():
                raise InputError(f"{where}: microphone {index} is at {position}; all coordinates must be finite.")
        if self.num_microphones < 2:
            raise InputError(f"{where}: it has {self.num_microphones} microphone(s); localization needs at least two.")
        for (i, first), (j, second) in combinations(enumerate(self.positions_m, start=1), 2):
            distance = math.dist(first, second)
            if distance < MIN_SPACING_M:
                raise InputError(f"{where}: microphones {i} and {j} are both at {first}; give different positions.")
            if distance > MAX_EXTENT_M:
                raise InputError(
                    f"{where}: microphones {i} and {j} are {distance:.4g} m apart, more than {MAX_EXTENT_M:g} m; "
                    "give positions in metres, not millimetres."
                )
        if not (np.isfinite(self.speed_of_sound) and 100.0 <= self.speed_of_sound <= 2000.0):
            raise InputError(f"{where}: the speed of sound is {self.speed_of_sound} m/s; give 100 to 2000 (air: 343).")
        self.steering.check(self)
        if self.channels is not None:
            self._check_channels(self.channels, where)

    def _check_channels(self, channels: tuple[int, ...], where: str) -> None:
        if len(channels) != self.num_microphones:
            raise InputError(
                f"{where}: 'channels' has {len(channels)} entries for {self.num_microphones} microphones; "
                "give one for each."
            )
        for microphone, channel in enumerate(channels, start=1):
            if channel < 1:
                raise InputError(f"{where}: microphone {microphone} is on channel {channel}; channels count from 1.")
            other = channels.index(channel) + 1
            if other != microphone:
                raise InputError(
                    f"{where}: microphones {other} and {microphone} are both on channel {channel}; give different ones."
                )

    @property
    def num_microphones(self) -> int:
        decided = self.steering.num_microphones
        return len(self.positions_m) if decided is None else decided

    @property
    def positions(self) -> npt.NDArray[np.float64]:
        """Positions, (M, 3), metres; (0, 3) for an array without positions."""
        return np.array(self.positions_m, dtype=np.float64).reshape(-1, 3)

    @property
    def channel_indices(self) -> tuple[int, ...]:
        """The channel of each microphone in a recording, counted from 0."""
        if self.channels is None:
            return tuple(range(self.num_microphones))
        return tuple(channel - 1 for channel in self.channels)

    def steering_vectors(self, grid: DirectionGrid, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        """Computes the steering vectors of the array, complex128 (F, D, M).

        Raises:
            InputError: measured responses cannot be read, or end below the frequencies.
        """
        return self.steering.model(self)(grid, frequencies_hz)

    def select(self, channels: tuple[int, ...], name: str | None = None) -> "MicrophoneArray":
        """Returns the sub-array of microphones (counted from 0), in the given order.

        Raises:
            InputError: an array with this steering has no sub-arrays.
        """
        if self.steering.num_microphones is not None:
            raise InputError(f"array '{self.name}' is {self.steering.description}; it has no sub-arrays.")
        positions = tuple(self.positions_m[channel] for channel in channels)
        mapped = None if self.channels is None else tuple(self.channels[channel] for channel in channels)
        return MicrophoneArray(name or self.name, positions, self.speed_of_sound, self.steering, mapped)

    def to_dict(self) -> dict[str, Any]:
        """Returns plain values, without those that equal the defaults."""
        data: dict[str, Any] = {"name": self.name, "speed_of_sound": self.speed_of_sound}
        if self.positions_m:
            data["positions_m"] = [list(position) for position in self.positions_m]
        if self.channels is not None:
            data["channels"] = list(self.channels)
        if self.steering != FreeFieldKind():
            data["steering"] = self.steering.to_dict()
        return data

    @classmethod
    def from_dict(cls, data: Any, where: str = "array description", folder: Path = Path()) -> "MicrophoneArray":
        """Builds an array from the mapping that :meth:`to_dict` writes.

        Args:
            data: mapping of keys to values.
            where: name of the source in messages.
            folder: folder to which the path of a SOFA file is relative.

        Raises:
            InputError: a key is missing, unknown, or has the wrong type, or the geometry is wrong.
        """
        if not isinstance(data, dict):
            raise InputError(f"{where}: expected keys 'name' and 'positions_m', found {type(data).__name__}.")
        unknown = sorted(set(map(str, data)) - set(KEYS))
        if unknown:
            raise InputError(f"{where}: unknown key '{unknown[0]}'; known are {', '.join(KEYS)}.")
        steering = (
            steering_from_dict(data["steering"], where, folder) if data.get("steering") is not None else FreeFieldKind()
        )
        if "positions_m" not in data and steering.num_microphones is None:
            raise InputError(f"{where}: 'positions_m' is missing; give one [x, y, z] row in metres per microphone.")
        rows = data.get("positions_m", [])
        if not isinstance(rows, list) or not all(isinstance(row, list | tuple) for row in rows):
            raise InputError(f"{where}: 'positions_m' must be a list of [x, y, z] rows in metres.")
        channels = data.get("channels")
        if channels is not None and not (
            isinstance(channels, list | tuple) and all(type(channel) is int for channel in channels)
        ):
            raise InputError(f"{where}: 'channels' must be a list of whole numbers, one per microphone, from 1.")
        try:
            positions = tuple(tuple(float(value) for value in row) for row in rows)
            speed_of_sound = float(data.get("speed_of_sound", SPEED_OF_SOUND))
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(f"{where}: positions and speed of sound must be numbers ({error}).") from error
        try:
            return cls(
                str(data.get("name", Path(where).stem)),
                positions,  # type: ignore[arg-type]
                speed_of_sound,
                steering,
                None if channels is None else tuple(channels),
            )
        except InputError as error:
            raise InputError(f"{where}: {error}") from error

    def save(self, path: Path) -> None:
        """Writes the array as YAML."""
        write_atomically(path, yaml.safe_dump(self.to_dict(), sort_keys=False).encode())

    @classmethod
    def load(cls, path: Path) -> "MicrophoneArray":
        """Reads an array from YAML.

        Raises:
            InputError: the file cannot be read, is not YAML, or describes no valid array.
        """
        try:
            data = yaml.safe_load(path.read_text(encoding="utf-8"))
        except UnicodeDecodeError as error:
            raise InputError(
                f"{path} is no text file; give a YAML file, which may name a SOFA file of measured responses."
            ) from error
        except OSError as error:
            raise InputError(f"{path}: cannot read the array file ({error}).") from error
        # YAML's constructors may raise ValueError (a date such as 2020-13-45); deep nesting raises RecursionError.
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            problem = " ".join(str(error).split())
            raise InputError(f"{path}: not valid YAML ({problem}); expected 'positions_m' rows in metres.") from error
        return cls.from_dict(data, where=str(path), folder=path.parent)
