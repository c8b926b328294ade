"""Limits of an array's geometry, whatever it records.

These are ambiguous directions, spatial aliasing, exchanges of channels that only mirror the array, and parallax.
"""

from itertools import combinations

import numpy as np
import numpy.typing as npt
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import cdist

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.diagnosis.finding import Finding, Severity, listed

CHECK = "geometry"
# An extent below this share of the longest one, or below this many metres, counts as flat.
FLAT_SHARE, FLAT_M = 0.01, 1e-3
SAME_DISTANCE_M = 1e-4
FAR_FROM_CAMERA_M = 0.10


def principal_axes(positions_mx: npt.NDArray[np.float64]) -> tuple[int, npt.NDArray[np.float64]]:
    """Returns an array's dimension and its principal axes, (3, 3), longest first.

    The dimension is 1 for a line, 2 for a plane and 3 for a spatial array.
    """
    centred_mx = positions_mx - positions_mx.mean(axis=0)
    _, extents, axes_xx = np.linalg.svd(np.vstack([centred_mx, np.zeros((3, 3))]))
    return int((extents > max(FLAT_SHARE * extents[0], FLAT_M)).sum()), axes_xx


def is_mirror_blind(array: MicrophoneArray) -> bool:
    """Returns whether horizontal directions have mirror images of equal response.

    This holds for an array that is a line or an upright plane.
    """
    if not array.positions_m:
        return False
    dimension, axes_xx = principal_axes(array.positions)
    return dimension == 1 or (dimension == 2 and bool(abs(axes_xx[2, 2]) < 0.05))


def aliasing_limit_hz(array: MicrophoneArray) -> float:
    """Returns the frequency in Hz above which spatial aliasing starts, c / (2 d).

    The distance d is the longest edge of the minimum spanning tree of the microphones.
    """
    tree = minimum_spanning_tree(cdist(array.positions, array.positions))
    return array.speed_of_sound / (2 * float(tree.data.max()))


def exchange_classes(array: MicrophoneArray) -> list[list[tuple[int, int]]]:
    """Returns the exchanges of two channels in classes of congruent resulting arrays.

    No recording distinguishes the exchanges of one class. The first class holds the exchanges whose result is congruent
    to the array, and may be empty.
    """
    distance_mm = cdist(array.positions, array.positions)
    classes: list[list[tuple[int, int]]] = [[]]
    known_cmm = np.empty((array.num_microphones**2, *distance_mm.shape))
    known_cmm[0] = distance_mm
    for pair in combinations(range(array.num_microphones), 2):
        order = np.arange(array.num_microphones)
        order[list(pair)] = pair[::-1]
        exchanged_mm = distance_mm[order][:, order]
        apart_c = np.abs(known_cmm[: len(classes)] - exchanged_mm).max(axis=(1, 2))
        if apart_c.min() < SAME_DISTANCE_M:
            classes[int(apart_c.argmin())].append(pair)
        else:
            known_cmm[len(classes)] = exchanged_mm
            classes.append([pair])
    return classes


def check_geometry(array: MicrophoneArray) -> tuple[Finding, ...]:
    """Returns the limits of an array as notes; none of them is a fault."""
    if not array.positions_m:
        found = f"the array is {array.steering.description}; without positions there is no geometry to check"
        return (Finding(CHECK, Severity.NOTE, found, 1.0),)
    return (*_ambiguity(array), *_aliasing(array), *_hidden_exchanges(array), *_parallax(array))


def _ambiguity(array: MicrophoneArray) -> list[Finding]:
    dimension, axes_xx = principal_axes(array.positions)
    if dimension == 1:
        axis = axes_xx[0]
        azimuth_deg = float(np.rad2deg(np.arctan2(axis[1], axis[0]))) % 180
        lying = float(np.hypot(axis[0], axis[1])) > 0.95
        line = f"a line along azimuth {azimuth_deg:.0f} deg" if lying else "a line that is not horizontal"
        found = f"the microphones lie on {line}: directions on both sides of it sound alike (front-back ambiguity)"
        advice = "the picture has to decide; a third microphone off the line would end it"
        return [Finding(CHECK, Severity.NOTE, found, 1.0, advice)]
    if dimension == 3:
        return [Finding(CHECK, Severity.OK, "the microphones fill space: every direction sounds different", 1.0)]
    if is_mirror_blind(array):
        found = "the microphones lie in an upright plane: azimuths in front of and behind it sound alike"
        return [Finding(CHECK, Severity.NOTE, found, 1.0, "lay the array flat, or let the picture decide")]
    found = "the microphones lie in one plane: above and below it sound alike (up-down ambiguity), azimuths do not"
    return [Finding(CHECK, Severity.NOTE, found, 1.0, "nothing, as long as azimuths are what is wanted")]


def _aliasing(array: MicrophoneArray) -> list[Finding]:
    limit_hz = aliasing_limit_hz(array)
    if limit_hz >= SAMPLE_RATE / 2:
        found = f"spatial aliasing starts at {limit_hz:.0f} Hz, above what is recorded"
        return [Finding(CHECK, Severity.OK, found, 1.0)]
    few = array.num_microphones <= 3
    found = f"spatial aliasing starts at {limit_hz:.0f} Hz: above, a single frequency does not tell a direction" + (
        ", and few microphones leave false peaks" if few else ", all of them together still do"
    )
    return [Finding(CHECK, Severity.NOTE, found, 1.0, "closer microphones raise the limit" if few else "")]


def _hidden_exchanges(array: MicrophoneArray) -> list[Finding]:
    hidden = exchange_classes(array)[0]
    if not hidden:
        return []
    names = [f"{first + 1}-{second + 1}" for first, second in hidden]
    shown = [*names[:6], f"{len(names) - 6} more"] if len(names) > 7 else names
    found = f"an exchange of channels {listed(shown)} only mirrors the array: sound alone does not show it"
    return [Finding(CHECK, Severity.NOTE, found, 1.0, "clap beside each microphone once and look which is loudest")]


def _parallax(array: MicrophoneArray) -> list[Finding]:
    offset_m = float(np.linalg.norm(array.positions.mean(axis=0)[:2]))
    if offset_m <= FAR_FROM_CAMERA_M:
        return []
    shift_deg = float(np.rad2deg(np.arcsin(min(1.0, offset_m))))
    found = f"the array's middle is {100 * offset_m:.0f} cm from the camera's axis: up to {shift_deg:.0f} deg at 1 m"
    return [Finding(CHECK, Severity.NOTE, found, 1.0, "expect an error in azimuth for near sources")]
