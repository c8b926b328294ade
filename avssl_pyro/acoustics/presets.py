"""Preset arrays: the circles of the paper's Sec. IV and common hardware."""

from pathlib import Path

import numpy as np

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.steering_kinds import AmbisonicsKind, RigidSphereKind
from avssl_pyro.errors import InputError

PAPER_DIAMETER_M = 0.20
RESPEAKER4_OFFSET_M = 0.02285
RESPEAKER6_DIAMETER_M = 0.0926
SPHERE_RADIUS_M = 0.042

# Azimuth and elevation of the microphones of STARSS23's format "mic", degrees.
TETRAHEDRON_DEG = ((45.0, 35.0), (-45.0, -35.0), (135.0, -35.0), (-135.0, 35.0))
# Azimuth and elevation of the capsules of a 32-capsule sphere as mh acoustics numbers them, degrees. The tetrahedron
# has the capsules with the indices 5, 9, 25, 21.
EIGENMIKE_DEG = (
    *((0.0, 21.0), (32.0, 0.0), (0.0, -21.0), (-32.0, 0.0), (0.0, 58.0), (45.0, 35.0), (69.0, 0.0), (45.0, -35.0)),
    *((0.0, -58.0), (-45.0, -35.0), (-69.0, 0.0), (-45.0, 35.0), (91.0, 69.0), (90.0, 32.0), (90.0, -31.0)),
    *((89.0, -69.0), (180.0, 21.0), (-148.0, 0.0), (180.0, -21.0), (148.0, 0.0), (180.0, 58.0), (-135.0, 35.0)),
    *((-111.0, 0.0), (-135.0, -35.0), (180.0, -58.0), (135.0, -35.0), (111.0, 0.0), (135.0, 35.0), (-91.0, 69.0)),
    *((-90.0, 32.0), (-90.0, -32.0), (-89.0, -69.0)),
)


def circular_array(
    name: str,
    azimuths_deg: tuple[float, ...],
    diameter_m: float = PAPER_DIAMETER_M,
    channels: tuple[int, ...] | None = None,
) -> MicrophoneArray:
    """Places microphones on a horizontal circle at azimuths in degrees, counter-clockwise from x."""
    azimuths = np.deg2rad(azimuths_deg)
    x, y = diameter_m / 2 * np.cos(azimuths), diameter_m / 2 * np.sin(azimuths)
    positions = tuple((round(float(a), 9), round(float(b), 9), 0.0) for a, b in zip(x, y, strict=True))
    return MicrophoneArray(name, positions, channels=channels)


def uniform_circle(
    num_microphones: int, diameter_m: float = PAPER_DIAMETER_M, name: str | None = None
) -> MicrophoneArray:
    """Places microphones evenly on a circle, the first straight ahead; ``circleM`` is the default name."""
    azimuths_deg = tuple(360.0 * m / num_microphones for m in range(num_microphones))
    return circular_array(name or f"circle{num_microphones}", azimuths_deg, diameter_m)


def spherical_array(
    name: str, directions_deg: tuple[tuple[float, float], ...], radius_m: float = SPHERE_RADIUS_M
) -> MicrophoneArray:
    """Places microphones on a rigid sphere around the origin at azimuths and elevations in degrees."""
    azimuth_m, elevation_m = np.deg2rad(directions_deg).T
    flat_m = np.cos(elevation_m)
    unit_mx = np.stack([flat_m * np.cos(azimuth_m), flat_m * np.sin(azimuth_m), np.sin(elevation_m)], axis=-1)
    positions = tuple((round(x, 9), round(y, 9), round(z, 9)) for x, y, z in (radius_m * unit_mx).tolist())
    return MicrophoneArray(name, positions, steering=RigidSphereKind(radius_m))


def _respeaker4() -> MicrophoneArray:
    offset = RESPEAKER4_OFFSET_M
    corners = ((offset, offset, 0.0), (-offset, offset, 0.0), (-offset, -offset, 0.0), (offset, -offset, 0.0))
    return MicrophoneArray("respeaker4", corners)


def _respeaker6() -> MicrophoneArray:
    """Returns the circular kit of six microphones, which records eight channels, two of them for playback."""
    azimuths_deg = (120.0, 180.0, 240.0, 300.0, 0.0, 60.0)
    return circular_array("respeaker6", azimuths_deg, RESPEAKER6_DIAMETER_M, channels=(1, 2, 3, 4, 5, 6))


# circle246 is the union of the paper's circles, which have one diameter; its scenes can be read as any of them.
PRESETS: dict[str, MicrophoneArray] = {
    array.name: array
    for array in (
        uniform_circle(2),
        uniform_circle(4),
        uniform_circle(6),
        circular_array("circle246", (0.0, 60.0, 90.0, 120.0, 180.0, 240.0, 270.0, 300.0)),
        uniform_circle(5, 0.12),
        uniform_circle(16, name="robot16"),
        _respeaker4(),
        _respeaker6(),
        spherical_array("starss23-mic", TETRAHEDRON_DEG),
        MicrophoneArray("starss23-foa", steering=AmbisonicsKind()),
        spherical_array("eigenmike32", EIGENMIKE_DEG),
    )
}


def resolve_array(array: str | Path | MicrophoneArray) -> MicrophoneArray:
    """Returns the array of a preset's name or an array file's path; an array is returned unchanged.

    Raises:
        InputError: there is no such preset or file.

    >>> resolve_array("circle4").num_microphones
    4
    """
    if isinstance(array, MicrophoneArray):
        return array
    if str(array) in PRESETS:
        return PRESETS[str(array)]
    path = Path(array)
    if path.suffix in {".yaml", ".yml"} or path.exists():
        return MicrophoneArray.load(path)
    raise InputError(f"array '{array}' is neither a preset ({', '.join(PRESETS)}) nor a YAML file.")
