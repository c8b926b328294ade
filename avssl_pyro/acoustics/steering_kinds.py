"""Kinds of steering in an array's file, with their parameters."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from avssl_pyro.acoustics.measured import MeasuredResponses
from avssl_pyro.acoustics.sofa import read_sofa
from avssl_pyro.acoustics.spherical import CHANNEL_ORDERS, NORMALIZATIONS, FirstOrderAmbisonics, RigidSphere
from avssl_pyro.acoustics.steering import ArrayGeometry, FreeField, SteeringKind, SteeringModel
from avssl_pyro.errors import InputError

# Tolerance for positions rounded to millimetres.
ON_SPHERE_M = 2e-3
MAX_SPHERE_RADIUS_M = 1.0


@dataclass(frozen=True)
class FreeFieldKind:
    """Microphones in free field; see :class:`avssl_pyro.acoustics.steering.FreeField`."""

    kind: ClassVar[str] = "free-field"
    has_delays: ClassVar[bool] = True
    gains_are_free: ClassVar[bool] = True
    has_elevations: ClassVar[bool] = True
    num_microphones: ClassVar[None] = None
    description: ClassVar[str] = "in free field"

    def check(self, array: ArrayGeometry) -> None:
        """Accepts any positions."""

    def model(self, array: ArrayGeometry) -> SteeringModel:
        return FreeField(array)

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind}


@dataclass(frozen=True)
class RigidSphereKind:
    """Microphones on a rigid sphere; see :class:`avssl_pyro.acoustics.spherical.RigidSphere`.

    Args:
        radius_m: radius of the sphere, metres.
        centre_m: centre of the sphere in the array's coordinates, metres.

    Raises:
        InputError: the radius is not positive or is above 1 m.
    """

    kind: ClassVar[str] = "rigid-sphere"
    has_delays: ClassVar[bool] = True
    gains_are_free: ClassVar[bool] = True
    has_elevations: ClassVar[bool] = True
    num_microphones: ClassVar[None] = None

    radius_m: float
    centre_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not 0 < self.radius_m <= MAX_SPHERE_RADIUS_M:
            raise InputError(
                f"steering: radius_m is {self.radius_m:g}; give metres, above 0 and at most {MAX_SPHERE_RADIUS_M:g}."
            )

    @property
    def description(self) -> str:
        centre = ", ".join(f"{value:g}" for value in self.centre_m)
        return f"on a rigid sphere of radius {self.radius_m:g} m around ({centre})"

    def check(self, array: ArrayGeometry) -> None:
        distance_m = np.linalg.norm(array.positions - np.array(self.centre_m), axis=-1)
        for microphone, distance in enumerate(distance_m, start=1):
            if not abs(distance - self.radius_m) <= ON_SPHERE_M:
                raise InputError(
                    f"array '{array.name}': microphone {microphone} is {100 * distance:.4g} cm from the centre of the "
                    f"rigid sphere, whose radius is {100 * self.radius_m:.4g} cm; give a position on the surface."
                )

    def model(self, array: ArrayGeometry) -> SteeringModel:
        return RigidSphere(array, self.radius_m, self.centre_m)

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, "radius_m": self.radius_m, "centre_m": list(self.centre_m)}


@dataclass(frozen=True)
class AmbisonicsKind:
    """The four channels W, X, Y, Z; see :class:`avssl_pyro.acoustics.spherical.FirstOrderAmbisonics`.

    Raises:
        InputError: the order or the normalization is unknown.
    """

    kind: ClassVar[str] = "first-order-ambisonics"
    has_delays: ClassVar[bool] = False
    gains_are_free: ClassVar[bool] = False
    has_elevations: ClassVar[bool] = True
    num_microphones: ClassVar[int] = 4

    order: str = "acn"
    normalization: str = "sn3d"

    def __post_init__(self) -> None:
        for name, known in (("order", tuple(CHANNEL_ORDERS)), ("normalization", tuple(NORMALIZATIONS))):
            if getattr(self, name) not in known:
                raise InputError(f"steering: {name} is '{getattr(self, name)}'; known are {', '.join(known)}.")

    @property
    def description(self) -> str:
        return f"in first-order ambisonics ({self.order}, {self.normalization})"

    def check(self, array: ArrayGeometry) -> None:
        if len(array.positions):
            raise InputError(
                f"array '{array.name}': it has positions, but the channels of first-order ambisonics have none; "
                "leave 'positions_m' out."
            )

    def model(self, array: ArrayGeometry) -> SteeringModel:  # noqa: ARG002
        return FirstOrderAmbisonics(self.order, self.normalization)

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, "order": self.order, "normalization": self.normalization}


@dataclass(frozen=True)
class MeasuredKind:
    """Measured responses of a SOFA file; see :class:`avssl_pyro.acoustics.measured.MeasuredResponses`.

    Two objects are equal if their files have the same bytes. The file is read when steering vectors are first computed,
    unless ``responses`` are given.

    Args:
        file: path of the SOFA file.
        sha256: SHA-256 of the file, hexadecimal.
        num_microphones: number of receivers in the file.
        responses: responses in the file, if already read.
    """

    kind: ClassVar[str] = "measured"
    has_delays: ClassVar[bool] = True
    gains_are_free: ClassVar[bool] = False
    has_elevations: ClassVar[bool] = False

    file: Path = field(compare=False)
    sha256: str
    num_microphones: int
    responses: MeasuredResponses | None = field(default=None, compare=False, repr=False)

    @classmethod
    def read(cls, file: Path) -> "MeasuredKind":
        """Reads a SOFA file; raises InputError as :func:`avssl_pyro.acoustics.sofa.read_sofa` does."""
        responses = read_sofa(file)
        return cls(file, hashlib.sha256(file.read_bytes()).hexdigest(), responses.num_microphones, responses)

    @property
    def description(self) -> str:
        return f"described by the measured responses of {self.file.name} (SHA-256 {self.sha256[:8]})"

    def check(self, array: ArrayGeometry) -> None:
        if len(array.positions) not in {0, self.num_microphones}:
            raise InputError(
                f"array '{array.name}': it has {len(array.positions)} positions, but {self.file.name} has responses "
                f"of {self.num_microphones} microphones; give as many, or leave 'positions_m' out."
            )

    def model(self, array: ArrayGeometry) -> SteeringModel:  # noqa: ARG002
        return self.measured()

    def measured(self) -> MeasuredResponses:
        """Returns the responses; raises InputError if the file cannot be read or has changed."""
        if self.responses is not None:
            return self.responses
        found = MeasuredKind.read(self.file)
        if found != self:
            raise InputError(
                f"{self.file}: not the file used before (its SHA-256 begins with {found.sha256[:8]} instead of "
                f"{self.sha256[:8]}); restore that file."
            )
        return found.measured()

    def to_dict(self) -> dict[str, Any]:
        return {
            "kind": self.kind,
            "file": str(self.file),
            "sha256": self.sha256,
            "num_microphones": self.num_microphones,
        }


def steering_from_dict(data: Any, where: str, folder: Path = Path()) -> SteeringKind:
    """Builds a kind of steering from the mapping that its ``to_dict`` returns.

    Args:
        data: mapping of keys to values.
        where: name of the source in messages.
        folder: folder to which a relative ``file`` refers.

    Raises:
        InputError: the kind or a parameter is missing, unknown, or wrong.
    """
    kind = data.get("kind") if isinstance(data, dict) else None
    if not isinstance(kind, str) or kind not in _PARSERS:
        raise InputError(
            f"{where}: 'steering' must be a mapping with a kind of {', '.join(_PARSERS)}; found {_short(data)}."
        )
    known, parse = _PARSERS[kind]
    unknown = [str(name) for name in data if name not in {"kind", *known}]
    if unknown:
        raise InputError(
            f"{where}: unknown key '{min(unknown)}' under 'steering'; {kind} has {', '.join(known) or 'no keys'}."
        )
    try:
        return parse(data, folder)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _free_field(_data: dict[str, Any], _folder: Path) -> SteeringKind:
    return FreeFieldKind()


def _rigid_sphere(data: dict[str, Any], _folder: Path) -> SteeringKind:
    centre = data.get("centre_m", (0.0, 0.0, 0.0))
    if "radius_m" not in data:
        raise InputError("steering: 'radius_m' is missing; give the radius of the rigid sphere in metres.")
    if not isinstance(centre, list | tuple) or len(centre) != 3:
        raise InputError(f"steering: 'centre_m' must be [x, y, z] in metres; found {_short(centre)}.")
    try:
        radius_m, (x, y, z) = float(data["radius_m"]), map(float, centre)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"steering: radius_m and centre_m must be numbers ({error}).") from error
    return RigidSphereKind(radius_m, (x, y, z))


def _ambisonics(data: dict[str, Any], _folder: Path) -> SteeringKind:
    return AmbisonicsKind(**{name: str(data[name]) for name in ("order", "normalization") if name in data})


def _measured(data: dict[str, Any], folder: Path) -> SteeringKind:
    file = data.get("file")
    if not isinstance(file, str) or not file:
        raise InputError("steering: 'file' is missing; give the path of the SOFA file, relative to this file.")
    path = (folder / file).resolve()
    sha256, num_microphones = data.get("sha256"), data.get("num_microphones")
    if isinstance(sha256, str) and isinstance(num_microphones, int):
        return MeasuredKind(path, sha256, num_microphones)
    return MeasuredKind.read(path)


# Parameters and reader of each kind.
_PARSERS: dict[str, tuple[tuple[str, ...], Callable[[dict[str, Any], Path], SteeringKind]]] = {
    FreeFieldKind.kind: ((), _free_field),
    RigidSphereKind.kind: (("radius_m", "centre_m"), _rigid_sphere),
    AmbisonicsKind.kind: (("order", "normalization"), _ambisonics),
    MeasuredKind.kind: (("file", "sha256", "num_microphones"), _measured),
}


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
