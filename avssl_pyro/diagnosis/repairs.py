"""Repairs of faults between a recording and its array.

Each fault is represented by the repair that undoes it: an exchange, an inversion, a delay or a rescaling.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.steering_kinds import RigidSphereKind
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.diagnosis.finding import Severity, channels
from avssl_pyro.errors import InputError

Audio = npt.NDArray[np.float32]


class Repair(Protocol):
    """Repair of one fault, in the audio (B, M, N) at 16 kHz or in the array."""

    @property
    def check(self) -> str: ...

    @property
    def severity(self) -> Severity: ...

    def message(self, names: Sequence[int]) -> str:
        """Returns a description of the fault.

        Args:
            names: channel numbers in the file, from 0.
        """
        ...

    @property
    def advice(self) -> str:
        """Advice on how to remove the fault."""
        ...

    def mend(self, audio_bmn: Audio, array: MicrophoneArray) -> tuple[Audio, MicrophoneArray]:
        """Returns audio and array without the fault.

        Raises:
            InputError: the repaired array is invalid.
        """
        ...


@dataclass(frozen=True)
class Exchange:
    """Exchange of two channels.

    Args:
        pair: indices of the channels, from 0.
        twins: other exchanges that leave a congruent array, and are therefore indistinguishable in any recording.
        check: name of the check.
        severity: severity of the fault.
    """

    pair: tuple[int, int]
    twins: tuple[tuple[int, int], ...] = ()
    check: str = "channel order"
    severity: Severity = Severity.ERROR

    def message(self, names: Sequence[int]) -> str:
        either = [channels([names[m] for m in pair]) for pair in (self.pair, *self.twins)]
        return f"{', or '.join(either)} are exchanged"

    @property
    def advice(self) -> str:
        return "exchange their rows in the array file, or their cables, and run this again"

    def mend(self, audio_bmn: Audio, array: MicrophoneArray) -> tuple[Audio, MicrophoneArray]:
        order = np.arange(audio_bmn.shape[1])
        order[list(self.pair)] = self.pair[::-1]
        return audio_bmn[:, order], array


@dataclass(frozen=True)
class Inversion:
    """Inversion of a channel's sign.

    Args:
        channel: index of the channel, from 0.
        check: name of the check.
        severity: severity of the fault.
    """

    channel: int
    check: str = "polarity"
    severity: Severity = Severity.ERROR

    def message(self, names: Sequence[int]) -> str:
        if len(names) == 2:
            return f"{channels(list(names))} have opposite signs: one of them is inverted"
        return f"{channels([names[self.channel]])} is inverted: its sign is opposite to the others'"

    @property
    def advice(self) -> str:
        return "multiply the channel by -1, or mend its cable"

    def mend(self, audio_bmn: Audio, array: MicrophoneArray) -> tuple[Audio, MicrophoneArray]:
        sign_m1 = np.ones((audio_bmn.shape[1], 1), dtype=np.float32)
        sign_m1[self.channel] = -1
        return audio_bmn * sign_m1, array


@dataclass(frozen=True)
class Delay:
    """Common delay of some channels.

    Args:
        late: indices of the channels, from 0.
        delay_s: delay in seconds; negative if the channels are early.
        check: name of the check.
        severity: severity of the fault.
    """

    late: tuple[int, ...]
    delay_s: float
    check: str = "delays"
    severity: Severity = Severity.ERROR

    def message(self, names: Sequence[int]) -> str:
        samples = abs(self.delay_s) * SAMPLE_RATE
        size = f"{1e3 * abs(self.delay_s):.2f} ms ({samples:.1f} samples at {SAMPLE_RATE // 1000} kHz)"
        verb = "comes" if len(self.late) == 1 else "come"
        return f"{channels([names[m] for m in self.late])} {verb} {size} {'late' if self.delay_s > 0 else 'early'}"

    @property
    def advice(self) -> str:
        return "shift back against the other channels, or record all with one clock"

    def mend(self, audio_bmn: Audio, array: MicrophoneArray) -> tuple[Audio, MicrophoneArray]:
        mended_bmn = audio_bmn.copy()
        mended_bmn[:, list(self.late)] = advance(audio_bmn[:, list(self.late)], self.delay_s)
        return mended_bmn, array


@dataclass(frozen=True)
class Rescaling:
    """Wrong scale of the array's positions.

    Args:
        factor: ratio of the true positions to the given ones.
        check: name of the check.
        severity: severity of the fault.
    """

    factor: float
    check: str = "units"
    severity: Severity = Severity.ERROR

    def message(self, names: Sequence[int]) -> str:  # noqa: ARG002
        ratio, side = max(self.factor, 1 / self.factor), "small" if self.factor > 1 else "large"
        return f"the array's positions are about {ratio:.2g} times too {side} ({_likely_slip(ratio)})"

    @property
    def advice(self) -> str:
        return "give positions in metres, and a recording whose header holds its true sample rate"

    def mend(self, audio_bmn: Audio, array: MicrophoneArray) -> tuple[Audio, MicrophoneArray]:
        return audio_bmn, scaled(array, self.factor)


def _likely_slip(ratio: float) -> str:
    slips = {2.0: "radius for diameter?", 3.0: "sample rate?", 10.0: "mm for cm?", 100.0: "cm for m?", 1e3: "mm for m?"}
    return min(slips.items(), key=lambda item: abs(float(np.log(item[0] / ratio))))[1]


def scaled(array: MicrophoneArray, factor: float) -> MicrophoneArray:
    """Returns the array with positions, and its rigid sphere if any, multiplied.

    Raises:
        InputError: the scaled array is too small or too large.
    """
    x_mx = array.positions * factor
    steering = array.steering
    if isinstance(steering, RigidSphereKind):
        x, y, z = steering.centre_m
        centre_m = (factor * x, factor * y, factor * z)
        steering = replace(steering, radius_m=factor * steering.radius_m, centre_m=centre_m)
    positions_m = tuple((float(x), float(y), float(z)) for x, y, z in x_mx)
    return replace(array, positions_m=positions_m, steering=steering)


def advance(audio_n: Audio, time_s: float) -> Audio:
    """Returns audio (..., N) at 16 kHz, advanced by a time in seconds.

    The time may be a fraction of a sample. Zeros follow at the end.
    """
    length = audio_n.shape[-1]
    padded = length + 2 * (int(abs(time_s) * SAMPLE_RATE) + 64)
    frequencies = np.fft.rfftfreq(padded, 1 / SAMPLE_RATE)
    turned = np.fft.rfft(audio_n, padded) * np.exp(2j * np.pi * frequencies * time_s)
    return np.fft.irfft(turned, padded)[..., :length].astype(np.float32)


def possible(repair: Repair, array: MicrophoneArray) -> bool:
    """Returns whether the repaired array is valid."""
    try:
        repair.mend(np.zeros((1, array.num_microphones, 1), dtype=np.float32), array)
    except InputError:
        return False
    return True
