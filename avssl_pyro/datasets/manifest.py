"""What a folder of shards says about itself: the settings it was made with and a checksum of every shard."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.errors import InputError

FORMAT = "avssl-scenes/1"
MANIFEST_NAME = "manifest.json"


def shard_name(number: int) -> str:
    return f"scenes-{number:06d}.tar"


def to_json(data: object) -> bytes:
    """Readable UTF-8 JSON with a newline at the end; NaN and infinity are refused, for JSON has neither."""
    return (json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode()


@dataclass(frozen=True)
class DatasetSpec:
    """Everything that decides the bytes of a dataset.

    Args:
        configuration: settings of the simulator, as plain JSON values.
        seed: of the simulator.
        array: the microphones that were rendered.
        num_scenes: in all shards together.
        scenes_per_shard: the last shard may hold fewer.

    Raises:
        InputError: ``num_scenes`` or ``scenes_per_shard`` is not positive.
    """

    configuration: dict[str, Any]
    seed: int
    array: MicrophoneArray
    num_scenes: int
    scenes_per_shard: int

    def __post_init__(self) -> None:
        for name in ("num_scenes", "scenes_per_shard"):
            if getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name)}; give a number of at least 1.")

    @property
    def num_shards(self) -> int:
        return -(-self.num_scenes // self.scenes_per_shard)

    def scenes_of(self, shard: int) -> range:
        """Indices of the scenes in a shard."""
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
        # Through JSON and back, so that tuples compare equal to the lists a file gives.
        return json.loads(to_json(header))

    @classmethod
    def from_dict(cls, data: Any, where: str) -> "DatasetSpec":
        """Raises InputError, naming ``where``, when ``data`` is not what :meth:`to_dict` writes."""
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            found = data.get("format") if isinstance(data, dict) else type(data).__name__
            raise InputError(f"{where}: its format is {found!r}; this version reads '{FORMAT}'.")
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
    """A finished shard: its file name, how many scenes and bytes it holds, and their SHA-256 in hexadecimal."""

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
            raise InputError(f"{where}: a damaged shard entry ({type(error).__name__}: {error}).") from error
        if Path(record.name).name != record.name:
            raise InputError(f"{where}: shard '{record.name}' lies outside the folder.")
        return record


@dataclass(frozen=True)
class Manifest:
    """The specification of a finished dataset and its shards, in order."""

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
            InputError: there is none, it cannot be read, or its shards do not add up to its scenes.
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
                f"{path}: its shards do not add up to {spec.num_scenes} scenes in {spec.num_shards} shards; "
                "it was altered, make the scenes again."
            )
        return manifest


def read_json(path: Path) -> Any:
    """Raises InputError when the file is not UTF-8 JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{path}: not valid JSON ({error}).") from error


def first_difference(stored: Any, wanted: Any, field: str = "") -> tuple[str, Any, Any] | None:
    """The first field, as a dotted path, in which two JSON values differ, with both values (None where absent)."""
    if isinstance(stored, dict) and isinstance(wanted, dict):
        for key in [*stored, *(key for key in wanted if key not in stored)]:
            path = f"{field}.{key}" if field else str(key)
            difference = first_difference(stored.get(key), wanted.get(key), path)
            if difference is not None:
                return difference
        return None
    return None if stored == wanted else (field, stored, wanted)
