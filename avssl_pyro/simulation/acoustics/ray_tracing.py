"""Room responses by images of low order and ray tracing, with pyroomacoustics' hybrid method.

These rooms differ from those of the image method in all that networks may have learned from it. Walls scatter and
have different absorptions by wall and frequency, air absorbs, and the late sound comes from traced directions.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import pyroomacoustics as pra
from pyroomacoustics.directivities import CardioidFamily, DirectionVector
from scipy import fft, signal

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.simulation.acoustics.arrivals import sum_of_arrivals
from avssl_pyro.simulation.acoustics.reverberation import (
    RoomAcoustics,
    eyring_absorption,
    padded_responses,
    plane_wave_receiver,
    rendering_constants,
    reverberant_lead,
    sum_of_responses,
)
from avssl_pyro.validators import within

BANDS_HZ = (125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0)
WALLS = ("east", "west", "north", "south", "floor", "ceiling")
MIN_ABSORPTION, MAX_ABSORPTION = 0.01, 0.95
# Energy is counted in steps of 4 ms, within 25 cm of the array, from this many directions.
STEP_SAMPLES = SAMPLE_RATE // 250
RECEIVER_RADIUS_M = 0.25
NUM_DIRECTIONS = 64


@dataclass(frozen=True)
class RayTracing:
    """Images of low order, followed by the energies of traced rays as noise from their directions.

    Materials are random, but depend on the room alone. They have the room's reverberation time at middle frequencies
    by Eyring's formula.

    Args:
        image_order: highest order of reflections that are images.
        num_rays: number of rays per source.

    Raises:
        InputError: a number is out of range.
    """

    image_order: int = 3
    num_rays: int = 10_000
    kind: str = field(default="ray-traced", init=False)

    def __post_init__(self) -> None:
        within(0, 10).check(self, "image_order")
        within(100, 10_000_000).check(self, "num_rays")

    def lead_samples(self, rt60_s: float) -> int:
        return reverberant_lead(rt60_s)

    def responses(
        self,
        array: MicrophoneArray,
        sources_sx: npt.NDArray[np.float64],
        room: RoomAcoustics,
        rng: np.random.Generator,
        *,
        direct_only: bool = False,
    ) -> npt.NDArray[np.float32]:
        seed = int(rng.integers(2**31))
        box = self._box(array, room)
        for position in sources_sx @ room.to_room.T + room.array_position:
            box.add_source(position)
        if len(sources_sx):
            with rendering_constants():
                box.image_source_model()
                if not direct_only:
                    # The rays' scattering is drawn from a generator that is global to pyroomacoustics.
                    pra.random.seed(numpy=seed, libroom=seed)
                    box.ray_tracing()
        per_source = []
        for s, source in enumerate(box.sources):
            early_ml, late = _early(array, box, source, room, direct_only=direct_only)
            per_source.append(early_ml)
            if not direct_only:
                tail_ml = _tail(array, _energies(box, s), room, late, rng)
                per_source[s] = sum_of_responses(early_ml, tail_ml)
        return padded_responses(per_source, array.num_microphones)

    def _box(self, array: MicrophoneArray, room: RoomAcoustics) -> pra.ShoeBox:
        box = pra.ShoeBox(
            room.dims_m,
            fs=SAMPLE_RATE,
            materials=_materials(room),
            max_order=self.image_order,
            ray_tracing=True,
            air_absorption=True,
        )
        box.set_sound_speed(array.speed_of_sound)
        box.set_ray_tracing(
            n_rays=self.num_rays,
            receiver_radius=RECEIVER_RADIUS_M,
            hist_bin_size=STEP_SAMPLES / SAMPLE_RATE,
            time_thres=room.rt60_s,
            receiver_n_directions=NUM_DIRECTIONS,
        )
        # With a directivity, even one that is equal in all directions, energies are counted by direction.
        everywhere = CardioidFamily(DirectionVector(azimuth=0.0, colatitude=90.0, degrees=True), p=1.0)
        box.add_microphone(room.array_position, directivity=everywhere)
        return box


def _materials(room: RoomAcoustics) -> dict[str, pra.Material]:
    """Draws a material for each wall, equal for equal rooms."""
    rng = np.random.default_rng([round(1e6 * value) for value in (*room.dims_m, room.rt60_s)])
    length, width, height = room.dims_m
    area_w = np.array(
        [width * height, width * height, length * height, length * height, length * width, length * width]
    )
    weight_w = rng.uniform(0.5, 1.5, len(WALLS))
    weight_w *= area_w.sum() / (area_w @ weight_w)
    # Low tones are absorbed less, high ones more.
    tilt, middle = rng.uniform(0.05, 0.25), BANDS_HZ.index(1000.0)
    rise_b = 1 + tilt * (np.arange(len(BANDS_HZ)) - middle)
    absorption_wb = np.clip(
        eyring_absorption(room.rt60_s, room.dims_m) * weight_w[:, None] * rise_b, 0.01, MAX_ABSORPTION
    )
    scattering = float(rng.uniform(0.1, 0.5))
    return {
        wall: pra.Material({"coeffs": absorption_b.tolist(), "center_freqs": list(BANDS_HZ)}, scattering)
        for wall, absorption_b in zip(WALLS, absorption_wb, strict=True)
    }


def _early(
    array: MicrophoneArray, box: pra.ShoeBox, source: pra.SoundSource, room: RoomAcoustics, *, direct_only: bool
) -> tuple[npt.NDArray[np.float32], int]:
    """Renders the source and its images, (M, L), and returns the common delay in samples."""
    offset_kx = (source.images.T.astype(np.float64) - room.array_position) @ room.to_room
    distance_k = np.linalg.norm(offset_kx, axis=-1)
    order_k = np.asarray(source.orders)
    direct_ml, late = sum_of_arrivals(array, offset_kx[order_k == 0], np.ones(1))
    if direct_only:
        return direct_ml, late
    amplitude_kb = source.damping.T * np.exp(-0.5 * box.air_absorption * distance_k[:, None])
    color_kl = box.octave_bands.synthesis(amplitude_kb, min_phase=True).astype(np.float32)
    summed_ml = direct_ml
    for k in np.flatnonzero(order_k > 0):
        arrival_ml, _ = sum_of_arrivals(array, offset_kx[k : k + 1], np.ones(1))
        summed_ml = sum_of_responses(summed_ml, signal.fftconvolve(arrival_ml, color_kl[k : k + 1], axes=-1))
    return summed_ml, late


def _energies(box: pra.ShoeBox, s: int) -> npt.NDArray[np.float64]:
    """Returns the energies of the rays of source ``s`` by direction, frequency band and step, (D, B, T)."""
    histograms = box.rt_histograms[0][s]
    steps = max(histogram.shape[1] for histogram in histograms)
    energy_dbt = np.zeros((len(histograms), len(BANDS_HZ), steps))
    for d, histogram in enumerate(histograms):
        energy_dbt[d, :, : histogram.shape[1]] = histogram
    time_t = (np.arange(steps) + 0.5) * STEP_SAMPLES / SAMPLE_RATE
    energy_dbt *= np.exp(-box.air_absorption[:, None] * box.c * time_t)
    audible_t = np.flatnonzero(energy_dbt.sum(axis=(0, 1)) > 0)
    return energy_dbt[:, :, : audible_t[-1] + 1 if len(audible_t) else 0]


def _tail(
    array: MicrophoneArray,
    energy_dbt: npt.NDArray[np.float64],
    room: RoomAcoustics,
    late: int,
    rng: np.random.Generator,
) -> npt.NDArray[np.float32]:
    """Renders noise from every direction with the energies of its rays, (M, L), late by ``late`` samples."""
    num_samples = energy_dbt.shape[2] * STEP_SAMPLES
    if num_samples == 0:
        return np.zeros((array.num_microphones, 0), dtype=np.float32)
    receiver = plane_wave_receiver(array)
    length = fft.next_fast_len(num_samples + 2 * receiver.half, real=True)
    weight_bf = _band_weights(np.fft.rfftfreq(length, 1 / SAMPLE_RATE))
    spectrum_mf = np.zeros((array.num_microphones, length // 2 + 1), dtype=np.complex64)
    # pyroomacoustics counts the rays' directions of arrival on its own lattice, in the room's coordinates.
    direction_dx = pra.room.fibonacci_spherical_sampling(NUM_DIRECTIONS).T @ room.to_room
    response_dml = receiver.impulse_responses(direction_dx)
    for energy_bt, response_ml in zip(energy_dbt, response_dml, strict=True):
        white_n = rng.standard_normal(length, dtype=np.float32) / np.float32(np.sqrt(STEP_SAMPLES))
        band_bn = fft.irfft(fft.rfft(white_n) * weight_bf, length)[:, :num_samples]
        wave_n = np.sum(band_bn * np.repeat(np.sqrt(energy_bt), STEP_SAMPLES, axis=-1).astype(np.float32), axis=0)
        spectrum_mf += fft.rfft(wave_n, length) * fft.rfft(response_ml, length)
    tail_ml = fft.irfft(spectrum_mf, length)
    # The two parts are late by different numbers of samples.
    shift = late - receiver.half
    return np.pad(tail_ml, ((0, 0), (shift, 0))) if shift >= 0 else np.ascontiguousarray(tail_ml[:, -shift:])


def _band_weights(frequency_f: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Returns the amplitudes of octave bands, (B, F), which overlap and sum to one."""
    octave_f = np.log2(np.clip(frequency_f, BANDS_HZ[0], BANDS_HZ[-1]) / BANDS_HZ[0])
    distance_bf = np.abs(octave_f - np.arange(len(BANDS_HZ))[:, None])
    return np.clip(1 - distance_bf, 0.0, 1.0).astype(np.float32)
