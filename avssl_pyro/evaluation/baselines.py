"""Audio-only baselines: spatial spectra over the grid, peaks of which are the sources.

A new baseline is a subclass of :class:`Baseline` appended to :data:`BASELINES`, here or in a script of the user's own;
it then stands in every table.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

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


@dataclass(frozen=True)
class Baseline(ABC):
    """A spatial spectrum as a :class:`avssl_pyro.evaluation.methods.Method`.

    Subclasses have a name and implement :meth:`spectrum`. ``steering_fmd`` holds the array's own steering vectors, so
    that a baseline uses the same physics of a sphere or of measured responses as the model.

    Args:
        array: microphones of the clips, in the order of their channels.
        grid: directions searched, all at the height of the array.
        freq_range_hz: frequencies used, hertz.
        workers: number of processes that share the clips; None is one per core.
        stft_config: spectrogram, by default that of the model.
        settings: candidate peak settings.

    Raises:
        InputError: the baseline does not work with this kind of array.
    """

    name: ClassVar[str]
    needs_delays: ClassVar[bool] = False
    array: MicrophoneArray
    grid: DirectionGrid
    freq_range_hz: tuple[float, float] = DEFAULT_BAND_HZ
    workers: int | None = 1
    stft_config: StftConfig = field(default_factory=StftConfig)
    settings: Sequence[PeakSetting] = field(default=PEAK_SETTINGS, repr=False)

    def __post_init__(self) -> None:
        if not self.supports(self.array):
            raise InputError(
                f"{self.name} needs delays between microphones, but array '{self.array.name}' records "
                f"{self.array.steering.description}, whose channels differ in level alone; use MUSIC."
            )

    @classmethod
    def supports(cls, array: MicrophoneArray) -> bool:
        """Whether the array has delays between its channels, where the baseline needs them."""
        return array.steering.has_delays or not cls.needs_delays

    @abstractmethod
    def spectrum(self, x_mft: npt.NDArray[np.complex128]) -> Spectrum:
        """Power over the grid, (D,), of a spectrogram with all its bins, complex (M, F, T)."""

    @cached_property
    def steering_fmd(self) -> npt.NDArray[np.complex128]:
        """Steering vectors of every bin of the spectrogram, complex (F, M, D)."""
        every_bin = replace(self.stft_config, low_hz=0.0, high_hz=self.stft_config.sample_rate / 2, bin_step=1)
        steering_fdm: npt.NDArray[np.complex128] = self.array.steering_vectors(self.grid, every_bin.frequencies).numpy()
        return steering_fdm.transpose(0, 2, 1)

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
        spectrum_d = self.spectrum(self.spectrogram(clip))
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
        _ = self.steering_fmd
        spectra: list[Spectrum] = Parallel(n_jobs=self.workers or -1)(delayed(self.observe)(clip) for clip in clips)
        return spectra

    def decide(self, observation: Spectrum, setting: PeakSetting) -> Azimuths:
        return pick_peaks(observation, self.grid, setting)


class PyroomacousticsBaseline(Baseline):
    """A grid search of pyroomacoustics; subclasses name its class."""

    doa: ClassVar[type[DOA]]

    @property
    def num_sources(self) -> int:
        """Dimension of the signal subspace."""
        return subspace_sources(self.array)

    def spectrum(self, x_mft: npt.NDArray[np.complex128]) -> Spectrum:
        # A DOA object overwrites its own number of sources, so none is used twice; it also sorts its grid.
        doa = self.doa(
            # It requires positions even where the array has none; the steering vectors overrule them.
            self.array.positions.T if len(self.array.positions) else np.zeros((3, len(x_mft))),
            self.stft_config.sample_rate,
            self.stft_config.window,
            c=self.array.speed_of_sound,
            num_src=self.num_sources,
            azimuth=self.grid.azimuths,
        )
        doa.mode_vec = self.steering_fmd[..., np.argsort(self.grid.azimuths)]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            doa.locate_sources(x_mft, freq_range=list(self.freq_range_hz))
        spectrum_d = np.zeros(self.grid.num_directions)
        spectrum_d[self.grid.nearest(doa.grid.azimuth)] = doa.grid.values
        return spectrum_d


class SrpPhat(PyroomacousticsBaseline):
    """Steered response power with phase transform (DiBiase 2000); not for channels that differ in level alone."""

    name = "srp-phat"
    doa = SRP
    needs_delays = True
    # It has no signal subspace.
    num_sources = 1


class Music(PyroomacousticsBaseline):
    """MUSIC (Schmidt 1986)."""

    name = "music"
    doa = MUSIC


class NormMusic(PyroomacousticsBaseline):
    """MUSIC normalized per frequency (Salvati et al. 2014)."""

    name = "norm-music"
    doa = NormMUSIC


BASELINES: list[type[Baseline]] = [
    SrpPhat,
    Music,
    NormMusic,
]


def subspace_sources(array: MicrophoneArray) -> int:
    """Dimension of MUSIC's signal subspace: 2 for four microphones, 3 for six (the paper's Sec. IV-A), 1 for two."""
    return min(3, max(1, array.num_microphones // 2))


def default_baselines(
    array: MicrophoneArray,
    grid: DirectionGrid,
    workers: int | None = 1,
    freq_range_hz: tuple[float, float] = DEFAULT_BAND_HZ,
) -> tuple[Baseline, ...]:
    """All baselines of :data:`BASELINES` that work with the array."""
    return tuple(kind(array, grid, freq_range_hz, workers) for kind in BASELINES if kind.supports(array))
