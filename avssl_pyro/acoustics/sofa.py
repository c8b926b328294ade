"""Reads the horizontal responses of an array from a SOFA file (AES69), by the library sofar."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.signal

from avssl_pyro.acoustics.measured import GAP_TOLERANCE_DEG, MAX_GAP_DEG, MeasuredResponses, widest_gap_deg
from avssl_pyro.errors import InputError

# Spectra are kept at multiples of this, which are the bins of a window of 1024 samples at 16 kHz, and of 512.
STEP_HZ = 15.625
TOP_HZ = 8000.0
# Directions this close to the horizontal plane are enough if they go all around; if not, those up to the second.
ELEVATIONS_DEG = (0.5, 5.0)


def read_sofa(path: Path) -> MeasuredResponses:
    """Responses of every receiver to sources on the horizontal plane; azimuth is counter-clockwise, as in SOFA.

    Impulse responses (FIR) of any rate and transfer functions (TF) are read. Directions are those from the listener,
    relative to where it looks.

    Raises:
        InputError: the file cannot be read, holds other data, values that are not finite, fewer than two receivers, or
            leaves a gap of more than 10 degrees on the horizontal plane.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such SOFA file.")
    try:
        return _measured(_open(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _measured(sofa: Any) -> MeasuredResponses:
    response_dmn = _responses(sofa)
    azimuth_d, elevation_d = _directions(sofa, len(response_dmn))
    # Most files cover the sphere; all but its equator is left out before it is transformed.
    chosen = _horizontal(azimuth_d, elevation_d)
    response_dmn = response_dmn[chosen]
    if not np.isfinite(response_dmn).all():
        raise InputError("some of its responses are not finite numbers; export the measurement again.")
    transform = _spectra if np.iscomplexobj(response_dmn) else _spectra_of_impulses
    return MeasuredResponses(azimuth_d[chosen], *transform(sofa, response_dmn, chosen))


def _open(path: Path) -> Any:
    # Imported when needed: the library takes as long as all the rest of a small command.
    import sofar  # noqa: PLC0415

    try:
        sofa = sofar.read_sofa(str(path), verify=False, verbose=False)
    # The library lets whatever its parser meets in a damaged file through.
    except Exception as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"cannot be read as a SOFA file ({problem}).") from error
    if "SourcePosition" not in vars(sofa) or "GLOBAL_DataType" not in vars(sofa):
        raise InputError("it names no data type or no source positions; export the measurement again.")
    return sofa


def _numbers(sofa: Any, name: str, default: Any = np.nan) -> npt.NDArray[np.float64]:
    try:
        return np.asarray(getattr(sofa, name, default), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"'{name}' holds other things than numbers; export the measurement again.") from error


def _responses(sofa: Any) -> npt.NDArray[np.inexact[Any]]:
    """All responses as they are in the file, (D', M, N): samples, or complex where they are transfer functions."""
    kind = str(sofa.GLOBAL_DataType)
    if kind == "FIR":
        response_dmn: npt.NDArray[np.inexact[Any]] = _numbers(sofa, "Data_IR")
    elif kind == "TF":
        real, imag = _numbers(sofa, "Data_Real"), _numbers(sofa, "Data_Imag")
        if real.shape != imag.shape:
            raise InputError("real and imaginary parts differ in number; export the measurement again.")
        response_dmn = real + 1j * imag
    else:
        raise InputError(f"holds data of type '{kind}'; give impulse responses (FIR) or transfer functions (TF).")
    shape = response_dmn.shape
    if len(shape) != 3 or not response_dmn.size:
        raise InputError(f"its responses have the shape {shape}; (measurements, receivers, samples) is needed.")
    if shape[1] < 2:
        raise InputError(f"it has {shape[1]} receiver; an array has at least two, one for each microphone.")
    return response_dmn


Spectra = tuple[npt.NDArray[np.float64], npt.NDArray[np.complex128]]


def _spectra(sofa: Any, transfer_dmn: npt.NDArray[Any], _chosen: npt.NDArray[np.int64]) -> Spectra:
    """Frequencies of transfer functions in Hz, and these."""
    frequencies_n = np.atleast_1d(_numbers(sofa, "N"))
    if len(frequencies_n) != transfer_dmn.shape[-1]:
        raise InputError(
            f"it has {len(frequencies_n)} frequencies for transfer functions of {transfer_dmn.shape[-1]} values; "
            "export it again."
        )
    if not (frequencies_n[0] >= 0 and (np.diff(frequencies_n) > 0).all()):
        raise InputError("its frequencies must rise and not be negative; export it again.")
    return frequencies_n, transfer_dmn


def _spectra_of_impulses(sofa: Any, impulse_dmn: npt.NDArray[Any], chosen: npt.NDArray[np.int64]) -> Spectra:
    """Frequencies in Hz, and the transform of the impulse responses at these very frequencies, whatever their rate."""
    rate = float(_numbers(sofa, "Data_SamplingRate").flat[0])
    if not 2 * STEP_HZ <= rate < np.inf:
        raise InputError(f"a sampling rate of {rate:g} Hz cannot be; export the measurement again.")
    count = int(min(TOP_HZ, rate / 2) / STEP_HZ) + 1
    frequencies_n = STEP_HZ * np.arange(count, dtype=np.float64)
    spectrum_dmn = scipy.signal.zoom_fft(
        impulse_dmn, [0.0, frequencies_n[-1]], m=count, fs=rate, endpoint=True, axis=-1
    )
    delay_dm = np.atleast_2d(_numbers(sofa, "Data_Delay", default=np.zeros((1, impulse_dmn.shape[1]))))
    rows = len(delay_dm)
    if delay_dm.shape[1:] != impulse_dmn.shape[1:2] or 1 < rows <= chosen.max():
        raise InputError(f"'Data.Delay' has the shape {delay_dm.shape}, which fits no response; export it again.")
    # One row for all measurements, or one for each.
    delay_dm = delay_dm if rows == 1 else delay_dm[chosen]
    turns_dmn = delay_dm[..., None] * frequencies_n / rate
    delayed_dmn: npt.NDArray[np.complex128] = spectrum_dmn * np.exp(-2j * np.pi * turns_dmn)
    return frequencies_n, delayed_dmn


def _directions(sofa: Any, count: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Azimuth and elevation of the source of every measurement as the listener sees it, (D',), radians."""
    source_dx = _cartesian(sofa, "SourcePosition")
    listener_dx = _cartesian(sofa, "ListenerPosition", (0.0, 0.0, 0.0))
    front_dx = _unit(_cartesian(sofa, "ListenerView", (1.0, 0.0, 0.0)))
    up_dx = _unit(np.atleast_2d(_numbers(sofa, "ListenerUp", (0.0, 0.0, 1.0))))
    parts = (source_dx, listener_dx, front_dx, up_dx)
    if any(part.shape not in {(1, 3), (count, 3)} for part in parts):
        raise InputError(f"it has {count} measurements and as many source positions are needed; export it again.")
    toward_dx = np.broadcast_to(source_dx - listener_dx, (count, 3))
    distance_d = np.linalg.norm(toward_dx, axis=-1)
    if not (np.isfinite(distance_d).all() and distance_d.min() > 0 and all(np.isfinite(part).all() for part in parts)):
        raise InputError("a source lies where the listener is, or nowhere; directions need finite positions.")
    left_dx = np.cross(up_dx, front_dx)
    x_d, y_d, z_d = (np.sum(toward_dx * axis_dx, axis=-1) for axis_dx in (front_dx, left_dx, up_dx))
    azimuth_d = np.arctan2(y_d, x_d)
    # Rounding may leave a source straight behind at either side of the seam.
    return np.where(azimuth_d > np.pi - 1e-9, -np.pi, azimuth_d), np.arcsin(np.clip(z_d / distance_d, -1, 1))


def _cartesian(
    sofa: Any, name: str, default: tuple[float, float, float] = (np.nan, np.nan, np.nan)
) -> npt.NDArray[np.float64]:
    """Rows (x, y, z) of a position or view, whichever coordinates the file gives."""
    values = np.atleast_2d(_numbers(sofa, name, default))
    if values.shape[-1] != 3 or not str(getattr(sofa, f"{name}_Type", "cartesian")).startswith("spherical"):
        return values
    azimuth, elevation = np.deg2rad(values[:, 0]), np.deg2rad(values[:, 1])
    flat = np.cos(elevation)
    return values[:, 2:3] * np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)


def _unit(rows: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    with np.errstate(invalid="ignore"):
        return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def _horizontal(azimuth_d: npt.NDArray[np.float64], elevation_d: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Indices of the measurements around the horizontal plane, each azimuth once, by rising azimuth."""
    for limit_deg in ELEVATIONS_DEG:
        (near,) = np.nonzero(np.rad2deg(np.abs(elevation_d)) <= limit_deg)
        # Of those in one direction, but for rounding, the first and most level.
        near = near[np.argsort(np.abs(elevation_d[near]), kind="stable")]
        _, first = np.unique(np.rad2deg(azimuth_d[near]).round(2), return_index=True)
        chosen = near[first]
        if len(chosen):
            start, stop = widest_gap_deg(azimuth_d[chosen])
            if stop - start <= MAX_GAP_DEG + GAP_TOLERANCE_DEG:
                return chosen
    if not len(chosen):
        raise InputError(f"no source within {ELEVATIONS_DEG[-1]:g} degrees of the horizontal plane; measure there.")
    return chosen
