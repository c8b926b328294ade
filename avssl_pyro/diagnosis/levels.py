"""Dead channels, unequal gains, direct current: what the power of each channel tells."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.diagnosis.finding import Finding, Severity, channels
from avssl_pyro.recordings.excerpts import Excerpts

DEAD_DB = -40.0
UNEQUAL_DB = 6.0
SILENT_DBFS = -75.0
# Direct current counts from a thousandth of full scale, if it is also a tenth of the sound.
LEAST_DIRECT, DIRECT_SHARE = 1e-3, 0.1
LEAST_POWER = 1e-20


@dataclass(frozen=True)
class ChannelLevels:
    """Power of every channel.

    Args:
        power_bm: mean square about the mean, (B, M), full scale 1.
        direct_m: mean of all samples, (M,).
        names: the channels' numbers in the file, counted from 0.
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
        """Every channel against the median channel, (M,), dB: the median over excerpts that are not silent."""
        loud_bm = self.power_bm[self.loud_b]
        if not len(loud_bm):
            return np.zeros(self.power_bm.shape[1])
        level_bm = 10 * np.log10(np.maximum(loud_bm, LEAST_POWER))
        return np.asarray(np.median(level_bm - np.median(level_bm, axis=1, keepdims=True), axis=0))

    @property
    def loud_b(self) -> npt.NDArray[np.bool_]:
        """Excerpts in which something sounds, (B,)."""
        return 10 * np.log10(np.maximum(self.power_bm.max(axis=1), LEAST_POWER)) > SILENT_DBFS

    @property
    def dead(self) -> list[int]:
        """Channels that are digital zero, or far below the others, throughout."""
        zero_m = (self.power_bm <= LEAST_POWER).all(axis=0)
        return [m for m, below in enumerate(zero_m | (self.relative_db_m < DEAD_DB)) if below]


def check_levels(excerpts: Excerpts) -> tuple[Finding, ...]:
    """Silence, dead channels and drop-outs, unequal gains, direct current."""
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
    findings = [*_dead(levels), *_dropping_out(levels), *_unequal(levels), *_direct(levels)]
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


def _unequal(levels: ChannelLevels) -> list[Finding]:
    findings = []
    for channel, level_db in enumerate(levels.relative_db_m):
        if abs(level_db) > UNEQUAL_DB and channel not in levels.dead:
            side = "louder" if level_db > 0 else "softer"
            found = f"{channels([levels.names[channel]])} is {abs(level_db):.0f} dB {side} than the median channel"
            # A talker close to a large array makes a few decibels; nothing makes twenty.
            confidence = float(1 - 0.5 * np.exp((UNEQUAL_DB - abs(level_db)) / 3))
            findings.append(
                Finding("levels", Severity.WARNING, found, confidence, "set all gains alike, or scale the channel")
            )
    return findings


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
