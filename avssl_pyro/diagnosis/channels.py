"""Checks of single channels: levels, clipping, and copies of one signal."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.channel_gains import DEAD_DB, NAMED_DB, GainEstimator
from avssl_pyro.diagnosis.finding import Finding, Severity, channels
from avssl_pyro.recordings.excerpts import Excerpts

SILENT_DBFS = -75.0
# Direct current counts from a thousandth of full scale, if it is also a tenth of the sound.
LEAST_DIRECT, DIRECT_SHARE = 1e-3, 0.1
LEAST_POWER = 1e-20
# A sine may touch its top with a sample or two, not with three again and again.
LEAST_RUN, LEAST_RUNS = 3, 4
SAME_LEVEL = 1e-4
# Below this a recording has so few levels that many samples share the highest by chance.
LEAST_EXTREME = 1e-2
# Power that is left of a channel after the best multiple of another one is subtracted. Two microphones a
# centimetre apart keep a hundredth even without noise; a copy keeps rounding errors.
COPY_RESIDUE = 1e-4


@dataclass(frozen=True)
class ChannelLevels:
    """Power and mean of every channel.

    Args:
        power_bm: variance of the samples, (B, M), full scale 1.
        direct_m: mean of all samples, (M,).
        names: channel numbers in the file, from 0.
    """

    power_bm: npt.NDArray[np.float64]
    direct_m: npt.NDArray[np.float64]
    names: tuple[int, ...]

    @classmethod
    def of(cls, excerpts: Excerpts) -> "ChannelLevels":
        raw_bmn = excerpts.raw_bmn.astype(np.float64)
        return cls(raw_bmn.var(axis=-1), raw_bmn.mean(axis=(0, 2)), excerpts.names)

    @property
    def relative_db_m(self) -> npt.NDArray[np.float64]:
        """Level relative to the median channel in dB, (M,); median over excerpts that are not silent."""
        loud_bm = self.power_bm[self.loud_b]
        if not len(loud_bm):
            return np.zeros(self.power_bm.shape[1])
        level_bm = 10 * np.log10(np.maximum(loud_bm, LEAST_POWER))
        return np.asarray(np.median(level_bm - np.median(level_bm, axis=1, keepdims=True), axis=0))

    @property
    def loud_b(self) -> npt.NDArray[np.bool_]:
        """Mask of the excerpts that are not silent, (B,)."""
        return 10 * np.log10(np.maximum(self.power_bm.max(axis=1), LEAST_POWER)) > SILENT_DBFS

    @property
    def dead(self) -> list[int]:
        """Channels that are constant, or far below the others, throughout."""
        zero_m = (self.power_bm <= LEAST_POWER).all(axis=0)
        return [m for m, below in enumerate(zero_m | (self.relative_db_m < DEAD_DB)) if below]


def check_levels(excerpts: Excerpts, array: MicrophoneArray) -> tuple[Finding, ...]:
    """Checks for silence, dead channels, drop-outs, unequal gains and direct current.

    Args:
        excerpts: excerpts of the recording, with the array's channels.
        array: array, which decides whether gains are free.
    """
    levels = ChannelLevels.of(excerpts)
    if not levels.loud_b.any():
        return (
            Finding(
                "levels",
                Severity.ERROR,
                f"the recording is silent: no excerpt is louder than {SILENT_DBFS:g} dB of full scale",
                1.0,
                "record again with more gain, or give the right file",
            ),
        )
    findings = [*_dead(levels), *_dropping_out(levels), *_unequal(excerpts, levels, array), *_direct(levels)]
    return tuple(findings) or (Finding("levels", Severity.OK, "all channels sound about equally loud", 1.0),)


def _dead(levels: ChannelLevels) -> list[Finding]:
    advice = "mend the microphone or cable, or leave the channel out of the array file"
    findings = []
    for channel in levels.dead:
        if (levels.power_bm[:, channel] <= LEAST_POWER).all():
            found = f"{channels([levels.names[channel]])} is dead: constant throughout"
        else:
            found = (
                f"{channels([levels.names[channel]])} is dead: {-levels.relative_db_m[channel]:.0f} dB below the others"
            )
        findings.append(Finding("levels", Severity.ERROR, found, 1.0, advice))
    return findings


def _dropping_out(levels: ChannelLevels) -> list[Finding]:
    silent_bm = levels.power_bm[levels.loud_b] <= LEAST_POWER
    findings = []
    for channel, share in enumerate(silent_bm.mean(axis=0)):
        if share > 0 and channel not in levels.dead:
            name = channels([levels.names[channel]])
            found = f"{name} drops out: constant in {share:.0%} of the excerpts where others sound"
            findings.append(Finding("levels", Severity.WARNING, found, 1.0, "leave those stretches out of training"))
    return findings


def _unequal(excerpts: Excerpts, levels: ChannelLevels, array: MicrophoneArray) -> list[Finding]:
    gains = GainEstimator(array).estimate(excerpts.audio_bmn)
    # The level of a copy is that of a wrong routing, which has a finding of its own.
    passed_over = {*levels.dead, *(second for _, second, _ in find_duplicates(excerpts))}
    return [
        Finding(
            "levels",
            Severity.WARNING,
            gains.difference(channel, levels.names[channel]),
            # A talker close to a large array makes two decibels; nothing makes twenty.
            float(1 - 0.5 * np.exp((NAMED_DB - abs(gains.deviation_db_m[channel])) / 3)),
            "set all gains alike; localization estimates the difference and undoes it",
        )
        for channel in gains.unequal
        if channel not in passed_over
    ]


def _direct(levels: ChannelLevels) -> list[Finding]:
    sound_m = np.sqrt(levels.power_bm.mean(axis=0))
    findings = []
    for channel, (direct, sound) in enumerate(zip(levels.direct_m, sound_m, strict=True)):
        if abs(direct) > max(LEAST_DIRECT, DIRECT_SHARE * sound) and channel not in levels.dead:
            found = (
                f"{channels([levels.names[channel]])} carries direct current: its mean is {direct:+.4f} of full scale"
            )
            findings.append(Finding("levels", Severity.WARNING, found, 1.0, "high-pass the recording at 20 Hz or so"))
    return findings


def clipped_runs(samples_bn: npt.NDArray[np.float32]) -> tuple[int, float]:
    """Number of runs of three or more samples at an extreme, and its level; the worse of both signs."""
    worst = (0, 0.0)
    for sign in (1, -1):
        signed_bn = sign * samples_bn
        extreme = float(signed_bn.max())
        if extreme < LEAST_EXTREME:
            continue
        top_bn = np.pad(signed_bn >= extreme * (1 - SAME_LEVEL), ((0, 0), (1, 1)))
        edge = np.diff(top_bn.astype(np.int8), axis=-1)
        lengths = np.argwhere(edge == -1)[:, 1] - np.argwhere(edge == 1)[:, 1]
        worst = max(worst, (int((lengths >= LEAST_RUN).sum()), sign * extreme))
    return worst


def check_clipping(excerpts: Excerpts) -> tuple[Finding, ...]:
    """Checks for channels whose waveform is cut off."""
    findings = []
    seconds = excerpts.raw_bmn.shape[0] * excerpts.raw_bmn.shape[2] / excerpts.rate
    for channel in range(excerpts.num_channels):
        # Direct current is no run at an extreme.
        runs, level = clipped_runs(excerpts.raw_bmn[:, channel])
        if runs >= LEAST_RUNS and np.ptp(excerpts.raw_bmn[:, channel]) > LEAST_EXTREME:
            name = channels([excerpts.names[channel]])
            found = f"{name} is clipped: cut off at {level:+.3f} {runs} times in {seconds:.0f} s"
            confidence = float(1 - 0.5 ** (runs / LEAST_RUNS))
            findings.append(
                Finding("clipping", Severity.WARNING, found, confidence, "record with less gain; leave loud clips out")
            )
    return tuple(findings) or (Finding("clipping", Severity.OK, "no channel is cut off", 0.9),)


def find_duplicates(excerpts: Excerpts) -> list[tuple[int, int, float]]:
    """Pairs of channels that are copies, with the residue of their difference in power."""
    # The first difference lifts high frequencies, in which microphones differ even where they stand close together.
    steps_bmn = np.diff(excerpts.raw_bmn.astype(np.float64), axis=-1)
    gram_bmm = steps_bmn @ steps_bmn.swapaxes(1, 2)
    power_bm = np.diagonal(gram_bmm, axis1=1, axis2=2)
    pairs = []
    for first, second in combinations(range(excerpts.num_channels), 2):
        scale_b = power_bm[:, first] * power_bm[:, second]
        sounding_b = np.minimum(power_bm[:, first], power_bm[:, second]) > LEAST_POWER
        if not sounding_b.any():
            continue
        coherence_b = gram_bmm[sounding_b, first, second] ** 2 / scale_b[sounding_b]
        residue = float(np.median(1 - coherence_b))
        if residue < COPY_RESIDUE:
            pairs.append((first, second, max(residue, 0.0)))
    return pairs


def check_duplicates(excerpts: Excerpts) -> tuple[Finding, ...]:
    """Checks for pairs of channels that hold one signal."""
    findings = [
        Finding(
            "duplicates",
            Severity.ERROR,
            f"{channels([excerpts.names[first], excerpts.names[second]])} are copies of one signal",
            float(1 - 0.5 * residue / COPY_RESIDUE),
            "check the routing of the recorder; leave one of the two out of the array file",
        )
        for first, second, residue in find_duplicates(excerpts)
    ]
    return tuple(findings) or (Finding("duplicates", Severity.OK, "no two channels are copies", 1.0),)
