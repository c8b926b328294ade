"""Microphone array geometry: positions, their validation, and the YAML file that describes them."""

import math
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.errors import InputError

SPEED_OF_SOUND = 343.0
MAX_EXTENT_M = 5.0
MIN_SPACING_M = 1e-4


@dataclass(frozen=True)
class MicrophoneArray:
    """Positions of M microphones.

    Args:
        name: free text, shown in results.
        positions_m: M rows of (x, y, z) in metres; x forward, y left, z up, measured from the camera's axis.
        speed_of_sound: metres per second.

    Raises:
        InputError: for fewer than two microphones, non-finite positions, two microphones in one place, or an array
            wider than 5 m; the message names the microphone, counted from 1 as on the channel labels of a recorder.
    """

    name: str
    positions_m: tuple[tuple[float, float, float], ...]
    speed_of_sound: float = SPEED_OF_SOUND

    def __post_init__(self) -> None:
        where = f"array '{self.name}'"
        for index, position in enumerate(self.positions_m, start=1):
            if len(position) != 3:
                raise InputError(
                    f"{where}: microphone {index} has {len(position)} coordinates; give x, y, z in metres."
                )
            if not np.isfinite(position).all():
                raise InputError(f"{where}: microphone {index} lies at {position}; all coordinates must be finite.")
        if len(self.positions_m) < 2:
            raise InputError(f"{where}: it has {len(self.positions_m)} microphone(s); localization needs at least two.")
        for (i, first), (j, second) in combinations(enumerate(self.positions_m, start=1), 2):
            distance = math.dist(first, second)
            if distance < MIN_SPACING_M:
                raise InputError(
                    f"{where}: microphones {i} and {j} are both at {first}; every microphone needs its own place."
                )
            if distance > MAX_EXTENT_M:
                raise InputError(
                    f"{where}: microphones {i} and {j} are {distance:.4g} m apart, more than {MAX_EXTENT_M:g} m; "
                    "positions are in metres, were these millimetres?"
                )
        if not (np.isfinite(self.speed_of_sound) and 100.0 <= self.speed_of_sound <= 2000.0):
            raise InputError(
                f"{where}: a speed of sound of {self.speed_of_sound} m/s is out of range; air has about 343."
            )

    @property
    def num_microphones(self) -> int:
        return len(self.positions_m)

    @property
    def positions(self) -> npt.NDArray[np.float64]:
        """Positions, (M, 3), metres."""
        return np.array(self.positions_m, dtype=np.float64)

    def select(self, channels: tuple[int, ...], name: str | None = None) -> "MicrophoneArray":
        """The sub-array of the given channels (counted from 0), in the given order."""
        positions = tuple(self.positions_m[channel] for channel in channels)
        return MicrophoneArray(name or self.name, positions, self.speed_of_sound)

    def to_dict(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "speed_of_sound": self.speed_of_sound,
            "positions_m": [list(position) for position in self.positions_m],
        }

    @classmethod
    def from_dict(cls, data: Any, where: str = "array description") -> "MicrophoneArray":
        """Builds an array from the mapping that :meth:`to_dict` writes; ``where`` names the source in messages.

        Raises:
            InputError: a key is missing, unknown, or has the wrong type, or the geometry is wrong.
        """
        if not isinstance(data, dict):
            raise InputError(f"{where}: expected keys 'name' and 'positions_m', found {type(data).__name__}.")
        unknown = sorted(set(map(str, data)) - {"name", "positions_m", "speed_of_sound"})
        if unknown:
            raise InputError(f"{where}: unknown key '{unknown[0]}'; known are name, positions_m, speed_of_sound.")
        if "positions_m" not in data:
            raise InputError(f"{where}: 'positions_m' is missing; give one [x, y, z] row in metres per microphone.")
        rows = data["positions_m"]
        if not isinstance(rows, list) or not all(isinstance(row, list | tuple) for row in rows):
            raise InputError(f"{where}: 'positions_m' must be a list of [x, y, z] rows in metres.")
        try:
            positions = tuple(tuple(float(value) for value in row) for row in rows)
            speed_of_sound = float(data.get("speed_of_sound", SPEED_OF_SOUND))
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(f"{where}: positions and speed of sound must be numbers ({error}).") from error
        try:
            return cls(str(data.get("name", Path(where).stem)), positions, speed_of_sound)  # type: ignore[arg-type]
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
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{path}: cannot read the array file ({error}).") from error
        # YAML's own constructors let ValueError through (a date such as 2020-13-45), and deep nesting RecursionError.
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            problem = " ".join(str(error).split())
            raise InputError(f"{path}: not valid YAML ({problem}); expected 'positions_m' rows in metres.") from error
        return cls.from_dict(data, where=str(path))
