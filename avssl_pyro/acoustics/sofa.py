"""Readers of the responses of an array in a SOFA file (AES69), with the library sofar."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.signal

from avssl_pyro.acoustics.measured import GAP_TOLERANCE_DEG, MAX_GAP_DEG, MeasuredResponses, widest_gap_deg
from avssl_pyro.errors import InputError

# Spectra are computed at multiples of this frequency, the bins of a window of 1024 samples at 16 kHz.
STEP_HZ = 15.625
TOP_HZ = 8000.0
# Directions within the first elevation are used if they leave no gap, otherwise those within the second.
ELEVATIONS_DEG = (0.5, 5.0)


def read_sofa(path: Path) -> MeasuredResponses:
    """Reads the responses of every receiver to sources on the horizontal plane; azimuth is counter-clockwise.

    The file has impulse responses (FIR) of any rate or transfer functions (TF). Directions are relative to the
    listener's position and view.

    Raises:
        InputError: the file cannot be read, has other data, values that are not finite, fewer than two receivers, or a
            gap of more than 10 degrees on the horizontal plane.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such SOFA file; give the path of one.")
    try:
        return _measured(_open(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


@dataclass(frozen=True, eq=False)
class SofaImpulses:
    """Impulse responses of all measurements of a file, with their directions.

    Args:
        azimuths_d: azimuths relative to the listener's view, (D',), radians, counter-clockwise.
        elevations_d: elevations, (D',), radians.
        impulse_dmn: impulse responses with the file's delays, (D', M, N).
        sample_rate: sample rate of the responses in Hz.
    """

    azimuths_d: npt.NDArray[np.float64]
    elevations_d: npt.NDArray[np.float64]
    impulse_dmn: npt.NDArray[np.float64]
    sample_rate: int


def read_sofa_impulses(path: Path) -> SofaImpulses:
    """Reads the impulse responses of every receiver to every source, of a room or not.

    Raises:
        InputError: the file cannot be read, has transfer functions, values that are not finite, fewer than two
            receivers, or a sampling rate that is no whole number of Hz.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such SOFA file; give the path of one.")
    try:
        sofa = _open(path)
        response_dmn = _responses(sofa)
        if np.iscomplexobj(response_dmn):
            raise InputError("it has transfer functions; give impulse responses (FIR).")
        if not np.isfinite(response_dmn).all():
            raise InputError("some of its responses are not finite numbers; export the measurement again.")
        rate = float(_numbers(sofa, "Data_SamplingRate").flat[0])
        if not (1 <= rate < np.inf and rate == int(rate)):
            raise InputError(f"the sampling rate is {rate:g} Hz; give a positive whole number of Hz.")
        count = len(response_dmn)
        delay_dm = np.broadcast_to(_delays(sofa, response_dmn, count - 1)[:count], response_dmn.shape[:2])
        return SofaImpulses(*_directions(sofa, count), _delayed(response_dmn, delay_dm), int(rate))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _delayed(impulse_dmn: npt.NDArray[Any], delay_dm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Delays impulse responses by numbers of samples, which need not be whole."""
    if not delay_dm.any():
        return impulse_dmn
    if not (np.isfinite(delay_dm).all() and delay_dm.min() >= 0):
        raise InputError("'Data.Delay' has a negative value or no number; export the measurement again.")
    size = impulse_dmn.shape[-1] + int(np.ceil(delay_dm.max()))
    turns_dmn = delay_dm[..., None] * np.fft.rfftfreq(size)
    delayed_dmn: npt.NDArray[np.float64] = np.fft.irfft(
        np.fft.rfft(impulse_dmn, size) * np.exp(-2j * np.pi * turns_dmn), size
    )
    return delayed_dmn


def _measured(sofa: Any) -> MeasuredResponses:
    response_dmn = _responses(sofa)
    azimuth_d, elevation_d = _directions(sofa, len(response_dmn))
    # Most files cover the sphere; only the horizontal plane is transformed.
    chosen = _horizontal(azimuth_d, elevation_d)
    response_dmn = response_dmn[chosen]
    if not np.isfinite(response_dmn).all():
        raise InputError("some of its responses are not finite numbers; export the measurement again.")
    transform = _spectra if np.iscomplexobj(response_dmn) else _spectra_of_impulses
    return MeasuredResponses(azimuth_d[chosen], *transform(sofa, response_dmn, chosen))


def _open(path: Path) -> Any:
    # Imported on use, as the import takes as long as the rest of a small command.
    import sofar  # noqa: PLC0415

    try:
        sofa = sofar.read_sofa(str(path), verify=False, verbose=False)
    # The library does not catch the exceptions of its parser on damaged files.
    except Exception as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"cannot be read as a SOFA file ({problem}).") from error
    if "SourcePosition" not in vars(sofa) or "GLOBAL_DataType" not in vars(sofa):
        raise InputError("it has no data type or no source positions; export the measurement again.")
    return sofa


def _numbers(sofa: Any, name: str, default: Any = np.nan) -> npt.NDArray[np.float64]:
    try:
        return np.asarray(getattr(sofa, name, default), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"'{name}' has values that are no numbers; export the measurement again.") from error


def _responses(sofa: Any) -> npt.NDArray[np.inexact[Any]]:
    """Reads all responses, (D', M, N): real samples, or complex transfer functions."""
    kind = str(sofa.GLOBAL_DataType)
    if kind == "FIR":
        response_dmn: npt.NDArray[np.inexact[Any]] = _numbers(sofa, "Data_IR")
    elif kind == "TF":
        real, imag = _numbers(sofa, "Data_Real"), _numbers(sofa, "Data_Imag")
        if real.shape != imag.shape:
            raise InputError("real and imaginary parts differ in number; export the measurement again.")
        response_dmn = real + 1j * imag
    else:
        raise InputError(f"it has data of type '{kind}'; give impulse responses (FIR) or transfer functions (TF).")
    shape = response_dmn.shape
    if len(shape) != 3 or not response_dmn.size:
        raise InputError(f"the responses have shape {shape}; give (measurements, receivers, samples).")
    if shape[1] < 2:
        raise InputError(f"it has {shape[1]} receiver; give at least two, one for each microphone.")
    return response_dmn


Spectra = tuple[npt.NDArray[np.float64], npt.NDArray[np.complex128]]


def _spectra(sofa: Any, transfer_dmn: npt.NDArray[Any], _chosen: npt.NDArray[np.int64]) -> Spectra:
    """Returns frequencies in Hz and transfer functions."""
    frequencies_n = np.atleast_1d(_numbers(sofa, "N"))
    if len(frequencies_n) != transfer_dmn.shape[-1]:
        raise InputError(
            f"it has {len(frequencies_n)} frequencies for transfer functions of {transfer_dmn.shape[-1]} values; "
            "export it again."
        )
    if not (frequencies_n[0] >= 0 and (np.diff(frequencies_n) > 0).all()):
        raise InputError("its frequencies must increase and not be negative; export it again.")
    return frequencies_n, transfer_dmn


def _spectra_of_impulses(sofa: Any, impulse_dmn: npt.NDArray[Any], chosen: npt.NDArray[np.int64]) -> Spectra:
    """Returns frequencies in Hz and the transform of impulse responses of any rate at these frequencies."""
    rate = float(_numbers(sofa, "Data_SamplingRate").flat[0])
    if not 2 * STEP_HZ <= rate < np.inf:
        raise InputError(f"the sampling rate is {rate:g} Hz, which is out of range; export the measurement again.")
    count = int(min(TOP_HZ, rate / 2) / STEP_HZ) + 1
    frequencies_n = STEP_HZ * np.arange(count, dtype=np.float64)
    spectrum_dmn = scipy.signal.zoom_fft(
        impulse_dmn, [0.0, frequencies_n[-1]], m=count, fs=rate, endpoint=True, axis=-1
    )
    delay_dm = _delays(sofa, impulse_dmn, int(chosen.max()))
    # The file has one row for all measurements, or one row each.
    delay_dm = delay_dm if len(delay_dm) == 1 else delay_dm[chosen]
    turns_dmn = delay_dm[..., None] * frequencies_n / rate
    delayed_dmn: npt.NDArray[np.complex128] = spectrum_dmn * np.exp(-2j * np.pi * turns_dmn)
    return frequencies_n, delayed_dmn


def _delays(sofa: Any, impulse_dmn: npt.NDArray[Any], last: int) -> npt.NDArray[np.float64]:
    """Reads the delays of the receivers in samples, one row for all measurements or at least ``last`` + 1 rows."""
    delay_dm = np.atleast_2d(_numbers(sofa, "Data_Delay", default=np.zeros((1, impulse_dmn.shape[1]))))
    if delay_dm.shape[1:] != impulse_dmn.shape[1:2] or 1 < len(delay_dm) <= last:
        raise InputError(f"'Data.Delay' has the shape {delay_dm.shape}, which fits no response; export it again.")
    return delay_dm


def _directions(sofa: Any, count: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Returns azimuth and elevation of each source in the listener's coordinates, (D',), radians."""
    source_dx = _cartesian(sofa, "SourcePosition")
    listener_dx = _cartesian(sofa, "ListenerPosition", (0.0, 0.0, 0.0))
    front_dx = _unit(_cartesian(sofa, "ListenerView", (1.0, 0.0, 0.0)))
    up_dx = _unit(np.atleast_2d(_numbers(sofa, "ListenerUp", (0.0, 0.0, 1.0))))
    parts = (source_dx, listener_dx, front_dx, up_dx)
    if any(part.shape not in {(1, 3), (count, 3)} for part in parts):
        raise InputError(f"positions or views do not fit its {count} measurements; export it again.")
    toward_dx = np.broadcast_to(source_dx - listener_dx, (count, 3))
    distance_d = np.linalg.norm(toward_dx, axis=-1)
    if not (np.isfinite(distance_d).all() and distance_d.min() > 0 and all(np.isfinite(part).all() for part in parts)):
        raise InputError("a source is at the listener's position or not finite; export the measurement again.")
    left_dx = np.cross(up_dx, front_dx)
    x_d, y_d, z_d = (np.sum(toward_dx * axis_dx, axis=-1) for axis_dx in (front_dx, left_dx, up_dx))
    azimuth_d = np.arctan2(y_d, x_d)
    # Rounding may put a source straight behind on either side of +-180 degrees.
    return np.where(azimuth_d > np.pi - 1e-9, -np.pi, azimuth_d), np.arcsin(np.clip(z_d / distance_d, -1, 1))


def _cartesian(
    sofa: Any, name: str, default: tuple[float, float, float] = (np.nan, np.nan, np.nan)
) -> npt.NDArray[np.float64]:
    """Reads a position or view as rows (x, y, z), from Cartesian or spherical coordinates."""
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
    """Returns the measurements near the horizontal plane, one for each azimuth, by increasing azimuth."""
    for limit_deg in ELEVATIONS_DEG:
        (near,) = np.nonzero(np.rad2deg(np.abs(elevation_d)) <= limit_deg)
        # Of several measurements at one azimuth, the one with the least elevation is used.
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
