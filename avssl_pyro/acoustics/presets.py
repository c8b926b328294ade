"""Arrays known by name: the circles of the paper's Sec. IV and common hardware."""

from pathlib import Path

import numpy as np

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.errors import InputError

PAPER_DIAMETER_M = 0.20
RESPEAKER4_OFFSET_M = 0.02285


def circular_array(name: str, azimuths_deg: tuple[float, ...], diameter_m: float = PAPER_DIAMETER_M) -> MicrophoneArray:
    """Microphones on a horizontal circle at the given azimuths (degrees, counter-clockwise from x)."""
    azimuths = np.deg2rad(azimuths_deg)
    x, y = diameter_m / 2 * np.cos(azimuths), diameter_m / 2 * np.sin(azimuths)
    positions = tuple((round(float(a), 9), round(float(b), 9), 0.0) for a, b in zip(x, y, strict=True))
    return MicrophoneArray(name, positions)


def uniform_circle(num_microphones: int, diameter_m: float = PAPER_DIAMETER_M) -> MicrophoneArray:
    """Evenly spaced microphones, the first one straight ahead."""
    azimuths_deg = tuple(360.0 * m / num_microphones for m in range(num_microphones))
    return circular_array(f"circle{num_microphones}", azimuths_deg, diameter_m)


def _respeaker4() -> MicrophoneArray:
    offset = RESPEAKER4_OFFSET_M
    corners = ((offset, offset, 0.0), (-offset, offset, 0.0), (-offset, -offset, 0.0), (offset, -offset, 0.0))
    return MicrophoneArray("respeaker4", corners)


# circle246 is the union of the paper's circles, which share a diameter: a scene rendered for it can be read as any.
PRESETS: dict[str, MicrophoneArray] = {
    array.name: array
    for array in (
        uniform_circle(2),
        uniform_circle(4),
        uniform_circle(6),
        circular_array("circle246", (0.0, 60.0, 90.0, 120.0, 180.0, 240.0, 270.0, 300.0)),
        _respeaker4(),
    )
}


def resolve_array(name_or_path: str) -> MicrophoneArray:
    """A preset by name, or an array file by path.

    Raises:
        InputError: it is neither.
    """
    if name_or_path in PRESETS:
        return PRESETS[name_or_path]
    path = Path(name_or_path)
    if path.suffix in {".yaml", ".yml"} or path.exists():
        return MicrophoneArray.load(path)
    raise InputError(f"array '{name_or_path}' is neither a preset ({', '.join(PRESETS)}) nor a YAML file.")
