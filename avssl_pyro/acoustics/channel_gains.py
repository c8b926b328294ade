"""Relative gains and signs of an array's channels, estimated from its own sound.

A steering model fixes how much of a plane wave each microphone receives, but not how a device amplifies it. In a
frequency band in which all directions reach a microphone at about one level, its expected power is known wherever the
talkers are: the diffuse-field power of the array's own responses. What the loud bins have above it is gain.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import torch

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.room_templates import fibonacci_sphere
from avssl_pyro.acoustics.stft import stft
from avssl_pyro.acoustics.stft_config import StftConfig

# Rumble below and sensor noise above say nothing about gains.
BAND_HZ = (150.0, 6000.0)
NUM_DIRECTIONS = 200
# Standard deviation over directions in dB up to which a microphone's level counts as independent of direction. A rigid
# sphere of 4.2 cm has it up to 1 kHz, microphones in free field everywhere.
LARGEST_SHADOW_DB = 1.0
# Bins count down to this many decibels below the loud ones; quieter bins may hold each microphone's own noise.
LOUD_QUANTILE, LOUD_RANGE_DB = 0.99, 25.0
LEAST_BINS = 50
# Power relative to the median channel below which a channel is dead.
DEAD_DB = -40.0
LEAST_POWER = 1e-20
# A pair's sign is read where every direction leaves its channels at least this much in phase. Diffuse noise in small
# microphones leaves a mean of .2, and in simulated rooms no pair had a negative mean.
LEAST_COSINE, LEAST_AGREEMENT = 0.3, 0.15
# Correlation of a channel's levels with those of the others, as a share of its median over channels, below which the
# channel holds another sound; where even the median is low, all is noise.
DEAF_SHARE, LEAST_FOLLOWING = 0.35, 0.3
# Talkers at half a metre make honest differences of up to 1.8 dB across 20 cm; gains below this are left alone.
EVEN_DB = 1.5
# From this difference on, a channel is named to the user.
NAMED_DB = 3.0


@dataclass(frozen=True)
class ChannelGains:
    """Gains and signs of the channels of one device.

    Args:
        gain_db_m: gain of every channel relative to the median one, dB; 0 for a dead channel.
        turned_m: flags of the channels whose sign is opposite to the others'.
        dead_m: flags of the channels without sound.

    >>> gains = ChannelGains((0.0, 0.0, 9.0), (False, True, False), (False, False, False))
    >>> gains.remarks()
    ('channel 3 is 9 dB louder than the others', 'channel 2 has the opposite sign of the others')
    """

    gain_db_m: tuple[float, ...]
    turned_m: tuple[bool, ...]
    dead_m: tuple[bool, ...]

    @classmethod
    def equal(cls, num_channels: int) -> "ChannelGains":
        """Returns equal gains and signs."""
        none_m = (False,) * num_channels
        return cls((0.0,) * num_channels, none_m, none_m)

    @property
    def deviation_db_m(self) -> npt.NDArray[np.float64]:
        """Gain relative to the median channel, (M,), dB; of two live channels, relative to the other one."""
        num_live = len(self.dead_m) - sum(self.dead_m)
        return np.array(self.gain_db_m) * (2.0 if num_live == 2 else 1.0)

    @property
    def are_even(self) -> bool:
        """True if all signs are alike and no gain deviates by more than what near talkers explain."""
        return not any(self.turned_m) and bool((np.abs(self.deviation_db_m) < EVEN_DB).all())

    @classmethod
    def median(cls, gains: Sequence["ChannelGains"]) -> "ChannelGains":
        """Returns the gains of most of several clips of one device; a channel is dead if it is dead in all."""
        gain_db_m = np.median([one.gain_db_m for one in gains], axis=0)
        turned_m = np.mean([one.turned_m for one in gains], axis=0) > 0.5
        dead_m = np.all([one.dead_m for one in gains], axis=0)
        return cls(tuple(gain_db_m.tolist()), tuple(turned_m.tolist()), tuple(dead_m.tolist()))

    def compensated(self, audio_mn: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Returns audio (..., M, N) of equal gains and signs; the audio itself if they are even."""
        if self.are_even:
            return audio_mn
        sign_m = np.where(self.turned_m, -1.0, 1.0)
        factor_m = sign_m * 10.0 ** (-np.array(self.gain_db_m) / 20)
        return np.asarray(audio_mn * factor_m[:, None].astype(np.float32))

    @property
    def unequal(self) -> list[int]:
        """Channels from 0 whose gain differs by more than 3 dB; of two channels the louder one."""
        differs_m = np.abs(self.deviation_db_m) > NAMED_DB
        if len(self.dead_m) - sum(self.dead_m) == 2:
            differs_m &= np.array(self.gain_db_m) > 0
        return np.flatnonzero(differs_m).tolist()

    def difference(self, channel: int, name: int | None = None) -> str:
        """Returns a clause on the gain of a channel.

        Args:
            channel: index of the channel, from 0.
            name: channel number in the file, from 0; by default the index.
        """
        deviation_db = float(self.deviation_db_m[channel])
        number = (channel if name is None else name) + 1
        side = "louder" if deviation_db > 0 else "softer"
        others = "the other" if len(self.gain_db_m) == 2 else "the others"
        return f"channel {number} is {abs(deviation_db):.0f} dB {side} than {others}"

    def remarks(self, names: Sequence[int] | None = None) -> tuple[str, ...]:
        """Returns one clause for every dead, unequal or turned channel; channels count from 1.

        Args:
            names: channel numbers in the file, from 0; by default 0 to M - 1.
        """
        names = range(len(self.gain_db_m)) if names is None else names
        dead = [f"channel {names[m] + 1} is dead" for m, is_dead in enumerate(self.dead_m) if is_dead]
        unequal = [self.difference(m, names[m]) for m in self.unequal]
        turned = [
            f"channel {names[m] + 1} has the opposite sign of the others"
            for m, is_turned in enumerate(self.turned_m)
            if is_turned
        ]
        if len(names) == 2 and turned:
            turned = [f"channels {names[0] + 1} and {names[1] + 1} have opposite signs"]
        return (*dead, *unequal, *turned)


class GainEstimator:
    """Estimates the gains and signs of an array's channels.

    Where the steering model fixes them, as in ambisonics and measured responses, all are taken as equal.

    Args:
        array: array of the channels.
        config: STFT of the estimate.

    >>> from avssl_pyro.acoustics.presets import PRESETS
    >>> noise_n = np.random.default_rng(0).standard_normal(16_000).astype(np.float32)
    >>> estimator = GainEstimator(PRESETS["circle4"])
    >>> estimator.estimate(np.stack([noise_n, noise_n, 2 * noise_n, -noise_n])[None]).remarks()
    ('channel 3 is 6 dB louder than the others', 'channel 4 has the opposite sign of the others')
    """

    def __init__(self, array: MicrophoneArray, config: StftConfig | None = None) -> None:
        self.array = array
        # Half-overlapping windows lose nothing of power.
        config = StftConfig() if config is None else config
        self.config = replace(config, hop=max(config.hop, config.window // 2))
        frequencies_hz = self.config.frequencies
        self._band_f = (frequencies_hz >= BAND_HZ[0]) & (frequencies_hz <= BAND_HZ[1])
        if not array.steering.gains_are_free:
            return
        pressure_fdm = array.steering.model(array).pressure(fibonacci_sphere(NUM_DIRECTIONS), frequencies_hz)
        power_fdm = np.maximum(np.abs(pressure_fdm) ** 2, LEAST_POWER)
        level_fdm, expected_fm = 10 * np.log10(power_fdm), 10 * np.log10(power_fdm.mean(axis=1))
        shadow_f = np.sqrt(((level_fdm - expected_fm[:, None]) ** 2).mean(axis=(1, 2)))
        self._band_f &= shadow_f < LARGEST_SHADOW_DB
        self._expected_fm = expected_fm[self._band_f]
        phasor_fdm = pressure_fdm[self._band_f] / np.sqrt(power_fdm[self._band_f])
        # One direction at a time: all of them at once would fill the memory for 32 microphones.
        cosine_fmm = np.ones((len(phasor_fdm), array.num_microphones, array.num_microphones))
        for phasor_fm in phasor_fdm.swapaxes(0, 1):
            np.minimum(cosine_fmm, (phasor_fm[:, :, None] * phasor_fm[:, None].conj()).real, out=cosine_fmm)
        in_phase_fmm = (cosine_fmm > LEAST_COSINE) & ~np.eye(array.num_microphones, dtype=bool)
        # Above the last of these frequencies no pair is close enough.
        num_near = int(np.flatnonzero(in_phase_fmm.any(axis=(1, 2))).max(initial=-1)) + 1
        self._in_phase_fmm = in_phase_fmm[:num_near]

    def estimate(self, audio_bmn: npt.NDArray[np.float32]) -> ChannelGains:
        """Estimates the gains of excerpts (B, M, N) of one device at 16 kHz; louder excerpts count more.

        Silence has equal gains.

        Raises:
            InputError: the excerpts are not longer than half a window.
        """
        num_channels = audio_bmn.shape[1]
        if not (self.array.steering.gains_are_free and self._band_f.any()):
            return ChannelGains.equal(num_channels)
        dead_m = _dead(audio_bmn)
        live = np.flatnonzero(~dead_m)
        gain_db_m, turned_m = np.zeros(num_channels), np.zeros(num_channels, dtype=bool)
        if len(live) > 1:
            level_nm, agreement_mm = self._compared(audio_bmn[:, live], live)
            if len(level_nm) >= LEAST_BINS:
                median_m = np.median(level_nm - level_nm.mean(axis=1, keepdims=True), axis=0)
                gain_db_m[live] = np.where(_deaf(level_nm), 0.0, median_m - np.median(median_m))
                turned_m[live] = _turned(agreement_mm)
        return ChannelGains(tuple(gain_db_m.tolist()), tuple(turned_m.tolist()), tuple(dead_m.tolist()))

    def _compared(
        self, audio_bmn: npt.NDArray[np.float32], live: npt.NDArray[np.intp]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Returns levels of N loud bins in dB above those expected, (N, M), and mean cosines of phases, (M, M).

        Cosines of pairs that stand too far apart are 0.
        """
        spectrograms = [self._spectrogram(audio_mn) for audio_mn in audio_bmn]
        threshold = max(map(_loud_power, spectrograms)) * 10 ** (-LOUD_RANGE_DB / 10)
        near = slice(0, len(self._in_phase_fmm))
        in_phase_fmm = self._in_phase_fmm[:, live][:, :, live]
        levels, cosine_mm, count_mm = [], np.zeros((len(live),) * 2), np.zeros((len(live),) * 2)
        for x_fmt in spectrograms:
            power_fmt = np.abs(x_fmt) ** 2
            loud_ft = np.median(power_fmt, axis=1) > threshold
            level_ftm = 10 * np.log10(np.maximum(power_fmt, LEAST_POWER)).swapaxes(1, 2)
            levels.append((level_ftm - self._expected_fm[:, None, live])[loud_ft])
            loud_ft = loud_ft[near]
            phasor_fmt = x_fmt[near] / np.sqrt(np.maximum(power_fmt[near], LEAST_POWER)) * loud_ft[:, None]
            cosine_fmm = (phasor_fmt @ phasor_fmt.conj().swapaxes(1, 2)).real
            cosine_mm += (cosine_fmm * in_phase_fmm).sum(axis=0)
            count_mm += (in_phase_fmm * loud_ft.sum(axis=1)[:, None, None]).sum(axis=0)
        return np.concatenate(levels), np.where(count_mm < LEAST_BINS, 0.0, cosine_mm / np.maximum(count_mm, 1))

    def _spectrogram(self, audio_mn: npt.NDArray[np.float32]) -> npt.NDArray[np.complex64]:
        x_fmt = stft(torch.from_numpy(np.ascontiguousarray(audio_mn))[None], self.config)[0].numpy()
        return np.asarray(x_fmt[self._band_f])


def _loud_power(x_fmt: npt.NDArray[np.complex64]) -> float:
    return float(np.quantile(np.median(np.abs(x_fmt) ** 2, axis=1), LOUD_QUANTILE))


def _dead(audio_bmn: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Returns flags of the channels that are constant, or far below the median of the others, (M,)."""
    power_m = audio_bmn.var(axis=-1, dtype=np.float64).mean(axis=0)
    sounding_m = power_m > LEAST_POWER
    if not sounding_m.any():
        return np.zeros(len(power_m), dtype=bool)
    return np.asarray(power_m < max(LEAST_POWER, np.median(power_m[sounding_m]) * 10 ** (DEAD_DB / 10)))


def _deaf(level_nm: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Returns flags of the channels whose level does not follow that of the others, (M,); theirs is no gain."""
    offset_nm = level_nm - level_nm.mean(axis=0)
    others_nm = offset_nm.sum(axis=1, keepdims=True) - offset_nm
    scale_m = np.sqrt((offset_nm**2).mean(axis=0) * (others_nm**2).mean(axis=0))
    follows_m = (offset_nm * others_nm).mean(axis=0) / np.maximum(scale_m, LEAST_POWER)
    return np.asarray((np.median(follows_m) > LEAST_FOLLOWING) & (follows_m < DEAF_SHARE * np.median(follows_m)))


def _turned(agreement_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Returns flags of the channels in the smaller of two groups of opposite sign, (M,).

    Args:
        agreement_mm: mean cosine of the phase between channels, 0 where a pair is too far apart.
    """
    # Of all signs, those of the first eigenvector agree best with the pairs.
    sign_m = np.where(np.linalg.eigh(agreement_mm)[1][:, -1] < 0, -1.0, 1.0)
    known_m = np.maximum((agreement_mm != 0).sum(axis=1), 1)
    sure_m = sign_m * (agreement_mm @ sign_m) / known_m > LEAST_AGREEMENT
    # Of two equal groups, that of the first channel is the reference.
    reference = np.sign(sign_m[sure_m].sum()) or sign_m[0]
    return np.asarray(sure_m & (sign_m != reference))
