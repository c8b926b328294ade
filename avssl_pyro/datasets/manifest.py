"""Manifest of a folder of shards: the settings of the dataset and a checksum of every shard."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.errors import InputError
from avssl_pyro.validators import at_least

FORMAT = "avssl-scenes/1"
MANIFEST_NAME = "manifest.json"


def shard_name(number: int) -> str:
    return f"scenes-{number:06d}.tar"


def to_json(data: object) -> bytes:
    """Encodes data as indented UTF-8 JSON with a final newline; NaN and infinity raise ValueError."""
    return (json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode()


@dataclass(frozen=True)
class DatasetSpec:
    """All settings that determine the bytes of a dataset.

    Args:
        configuration: settings of the simulator, as plain JSON values.
        seed: seed of the simulator.
        array: rendered microphones.
        num_scenes: number of scenes in all shards.
        scenes_per_shard: number of scenes in every shard but the last.

    Raises:
        InputError: ``num_scenes`` or ``scenes_per_shard`` is not positive.
    """

    configuration: dict[str, Any]
    seed: int
    array: MicrophoneArray
    num_scenes: int
    scenes_per_shard: int

    def __post_init__(self) -> None:
        at_least(1).check(self, "num_scenes", "scenes_per_shard")

    @property
    def num_shards(self) -> int:
        return -(-self.num_scenes // self.scenes_per_shard)

    def scenes_of(self, shard: int) -> range:
        """Returns the indices of the scenes in a shard."""
        first = shard * self.scenes_per_shard
        return range(first, min(first + self.scenes_per_shard, self.num_scenes))

    def to_dict(self) -> dict[str, Any]:
        header = {
            "format": FORMAT,
            "configuration": self.configuration,
            "seed": self.seed,
            "array": self.array.to_dict(),
            "num_scenes": self.num_scenes,
            "scenes_per_shard": self.scenes_per_shard,
        }
        # A round trip through JSON turns tuples into lists, which compare equal to those of a file.
        return json.loads(to_json(header))

    @classmethod
    def from_dict(cls, data: Any, where: str) -> "DatasetSpec":
        """Raises InputError, naming ``where``, when ``data`` is not what :meth:`to_dict` writes."""
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            found = data.get("format") if isinstance(data, dict) else type(data).__name__
            raise InputError(f"{where}: the format is {found!r}; this version reads '{FORMAT}'.")
        try:
            return cls(
                configuration=dict(data["configuration"]),
                seed=int(data["seed"]),
                array=MicrophoneArray.from_dict(data["array"], where=where),
                num_scenes=int(data["num_scenes"]),
                scenes_per_shard=int(data["scenes_per_shard"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{where}: damaged ({type(error).__name__}: {error}); make the scenes again.") from error


@dataclass(frozen=True)
class ShardRecord:
    """Record of a finished shard: file name, numbers of scenes and bytes, and hexadecimal SHA-256."""

    name: str
    num_scenes: int
    num_bytes: int
    sha256: str

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Any, where: str) -> "ShardRecord":
        """Raises InputError, naming ``where``, when ``data`` is not what :meth:`to_dict` writes."""
        try:
            record = cls(str(data["name"]), int(data["num_scenes"]), int(data["num_bytes"]), str(data["sha256"]))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{where}: a shard entry is damaged ({type(error).__name__}: {error}); make the scenes again."
            ) from error
        if Path(record.name).name != record.name:
            raise InputError(
                f"{where}: shard '{record.name}' is outside the folder; a shard's name must be a plain file name."
            )
        return record


@dataclass(frozen=True)
class Manifest:
    """Settings of a finished dataset and the records of its shards, in order."""

    spec: DatasetSpec
    shards: tuple[ShardRecord, ...]

    def to_dict(self) -> dict[str, Any]:
        return self.spec.to_dict() | {"shards": [shard.to_dict() for shard in self.shards]}

    def save(self, folder: Path) -> None:
        write_atomically(folder / MANIFEST_NAME, to_json(self.to_dict()))

    @classmethod
    def load(cls, folder: Path) -> "Manifest":
        """Reads the manifest of a folder.

        Raises:
            InputError: the manifest is missing or damaged, or its shards do not add up to its scenes.
        """
        path = folder / MANIFEST_NAME
        if not path.is_file():
            raise InputError(
                f"{folder}: no {MANIFEST_NAME}, so this is no finished set of scenes; "
                "run scripts/simulate.py or scripts/prepare.py with the same --out to make or complete it."
            )
        data = read_json(path)
        spec = DatasetSpec.from_dict(data, where=str(path))
        entries = data.get("shards")
        if not isinstance(entries, list):
            raise InputError(f"{path}: the list 'shards' is missing; make the scenes again.")
        manifest = cls(spec, tuple(ShardRecord.from_dict(entry, where=str(path)) for entry in entries))
        expected = [(shard_name(number), len(spec.scenes_of(number))) for number in range(spec.num_shards)]
        if [(shard.name, shard.num_scenes) for shard in manifest.shards] != expected:
            raise InputError(
                f"{path}: the shards do not add up to {spec.num_scenes} scenes in {spec.num_shards} shards; "
                "it was altered, make the scenes again."
            )
        return manifest


def read_json(path: Path) -> Any:
    """Reads UTF-8 JSON; raises InputError for a file of another format."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{path}: not valid JSON ({error}); make the scenes again.") from error


def first_difference(stored: Any, wanted: Any, field: str = "") -> tuple[str, Any, Any] | None:
    """Returns the dotted path and the values (None if absent) of the first difference of two JSON values."""
    if isinstance(stored, dict) and isinstance(wanted, dict):
        for key in [*stored, *(key for key in wanted if key not in stored)]:
            path = f"{field}.{key}" if field else str(key)
            difference = first_difference(stored.get(key), wanted.get(key), path)
            if difference is not None:
                return difference
        return None
    return None if stored == wanted else (field, stored, wanted)
