"""Audio-only baselines of pyroomacoustics behind our grid, our steering vectors, our peak picking and our tuning."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.signal
from joblib import Parallel, delayed
from pyroomacoustics.doa import MUSIC, SRP, NormMUSIC
from pyroomacoustics.doa.doa import DOA

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.metrics import Azimuths
from avssl_pyro.evaluation.peaks import PeakSetting, pick_peaks

# That of pyroomacoustics.
DEFAULT_BAND_HZ = (500.0, 4000.0)
Spectrum = npt.NDArray[np.float64]
THRESHOLDS = tuple(float(value) for value in np.arange(0.05, 1.0, 0.05).round(2))
MAX_PEAKS = (2, 3, 4)
PEAK_SETTINGS = tuple(PeakSetting(threshold, count) for count in MAX_PEAKS for threshold in THRESHOLDS)


def subspace_sources(array: MicrophoneArray) -> int:
    """Dimension of MUSIC's signal subspace: 2 for four microphones, 3 for six (the paper's Sec. IV-A), 1 for two."""
    return min(3, max(1, array.num_microphones // 2))


@dataclass(frozen=True)
class DoaBaseline:
    """A grid search of pyroomacoustics as a :class:`avssl_pyro.evaluation.methods.Method`.

    It searches by the array's own steering vectors, so that it knows as much of a sphere or of measured responses as
    the model does.

    Raises:
        InputError: SRP-PHAT is asked of channels that differ in level alone, which it whitens away.

    Args:
        name: how tables call it.
        doa: class of the algorithm, e.g. ``pyroomacoustics.doa.MUSIC``.
        array: the microphones the clips were recorded with, in the order of their channels.
        grid: directions searched, all at the height of the array.
        num_sources: dimension of the signal subspace; SRP-PHAT does not use it.
        freq_range_hz: frequencies used.
        stft_config: the spectrogram, by default that of the model.
        workers: processes that share the clips; None is one per core.
        settings: candidate peak settings.
    """

    name: str
    doa: type[DOA]
    array: MicrophoneArray
    grid: DirectionGrid
    num_sources: int = 1
    freq_range_hz: tuple[float, float] = DEFAULT_BAND_HZ
    stft_config: StftConfig = field(default_factory=StftConfig)
    workers: int | None = 1
    settings: Sequence[PeakSetting] = field(default=PEAK_SETTINGS, repr=False)

    def __post_init__(self) -> None:
        if self.doa is SRP and not self.array.steering.has_delays:
            raise InputError(
                f"{self.name} needs delays between microphones, but array '{self.array.name}' hears "
                f"{self.array.steering.description}, whose channels differ in level alone; use MUSIC."
            )

    @cached_property
    def _steering_fmd(self) -> npt.NDArray[np.complex128]:
        """Steering vectors of every bin of the STFT for the azimuths as pyroomacoustics sorts them, (F, M, D)."""
        frequencies = replace(self.stft_config, low_hz=0.0, high_hz=self.stft_config.sample_rate / 2, bin_step=1)
        steering_fdm = self.array.steering_vectors(self.grid, frequencies.frequencies).numpy()
        return steering_fdm[:, np.argsort(self.grid.azimuths)].transpose(0, 2, 1)

    def observe(self, clip: Clip) -> Spectrum:
        """Spatial spectrum over the grid, (D,), finite; flat where the clip is silent.

        Raises:
            InputError: the clip's channels do not match the array.
        """
        channels = clip.audio_mn.shape[0]
        if channels != self.array.num_microphones:
            raise InputError(
                f"clip '{clip.key}': it has {channels} channels but array '{self.array.name}' has "
                f"{self.array.num_microphones} microphones; both must agree."
            )
        x_mft = self.spectrogram(clip)
        # A DOA object overwrites its own number of sources, so none is used twice; it also sorts its grid.
        doa = self.doa(
            # Where there are no positions it wants some all the same; the steering vectors overrule them.
            self.array.positions.T if len(self.array.positions) else np.zeros((3, channels)),
            self.stft_config.sample_rate,
            self.stft_config.window,
            c=self.array.speed_of_sound,
            num_src=self.num_sources,
            azimuth=self.grid.azimuths,
        )
        doa.mode_vec = self._steering_fmd
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            doa.locate_sources(x_mft, freq_range=list(self.freq_range_hz))
        spectrum_d = np.zeros(self.grid.num_directions)
        spectrum_d[self.grid.nearest(doa.grid.azimuth)] = doa.grid.values
        # Without any noise MUSIC divides by zero in the true direction, and NormMUSIC infinity by infinity.
        finite_d = np.isfinite(spectrum_d)
        return np.where(finite_d, spectrum_d, 2 * spectrum_d[finite_d].max(initial=0.0) + 1.0)

    def spectrogram(self, clip: Clip) -> npt.NDArray[np.complex128]:
        """The model's spectrogram up to a constant factor, complex (M, F, T).

        Not by torch, whose threads take several times as long as the whole search when other processes are at work:
        the baselines shall not look slower than they are.
        """
        config = self.stft_config
        _, _, x_mft = scipy.signal.stft(
            clip.audio_mn.astype(np.float64),
            window="hann",
            nperseg=config.window,
            noverlap=config.window - config.hop,
            boundary="even",
            padded=False,
        )
        return np.asarray(x_mft, dtype=np.complex128)

    def observe_all(self, clips: Iterable[Clip]) -> list[Spectrum]:
        # Computed here, to be sent to every process instead of being computed in each.
        _ = self._steering_fmd
        spectra: list[Spectrum] = Parallel(n_jobs=self.workers or -1)(delayed(self.observe)(clip) for clip in clips)
        return spectra

    def decide(self, observation: Spectrum, setting: PeakSetting) -> Azimuths:
        return pick_peaks(observation, self.grid, setting)


def default_baselines(
    array: MicrophoneArray,
    grid: DirectionGrid,
    workers: int | None = 1,
    freq_range_hz: tuple[float, float] = DEFAULT_BAND_HZ,
) -> tuple[DoaBaseline, ...]:
    """SRP-PHAT (DiBiase 2000), MUSIC (Schmidt 1986) and MUSIC normalized per frequency (Salvati et al. 2014).

    SRP-PHAT is left out for ambisonics, which has no delays.
    """
    rank = subspace_sources(array)
    music = (
        DoaBaseline("music", MUSIC, array, grid, rank, freq_range_hz, workers=workers),
        DoaBaseline("norm-music", NormMUSIC, array, grid, rank, freq_range_hz, workers=workers),
    )
    if not array.steering.has_delays:
        return music
    return (DoaBaseline("srp-phat", SRP, array, grid, freq_range_hz=freq_range_hz, workers=workers), *music)
