"""What may be wrong between a recording and its array, each as the repair that would undo it."""

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
    """Undoes one fault, in the audio (B, M, N) at 16 kHz or in the array."""

    @property
    def check(self) -> str: ...

    @property
    def severity(self) -> Severity: ...

    def message(self, names: Sequence[int]) -> str:
        """The fault; ``names`` are the channels' numbers in the file, counted from 0."""
        ...

    @property
    def advice(self) -> str:
        """What to do."""
        ...

    def mend(self, audio_bmn: Audio, array: MicrophoneArray) -> tuple[Audio, MicrophoneArray]:
        """Audio and array as they would be without the fault.

        Raises:
            InputError: the array would be none.
        """
        ...


@dataclass(frozen=True)
class Exchange:
    """Two channels changed places.

    Args:
        pair: the channels, counted from 0.
        twins: other exchanges that leave a congruent array, so that no sound tells which it was.
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
    """A channel has the wrong sign."""

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
    """Some channels come late (or early, if negative) by the same time."""

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
    """The positions are in another unit: true ones are ``factor`` times as large."""

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
    """The array with all positions multiplied, and the sphere they lie on.

    Raises:
        InputError: no array is so small or so large.
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
    """Audio (..., N) at 16 kHz played earlier by a time that need not be whole samples; zeros come in at the end."""
    length = audio_n.shape[-1]
    padded = length + 2 * (int(abs(time_s) * SAMPLE_RATE) + 64)
    frequencies = np.fft.rfftfreq(padded, 1 / SAMPLE_RATE)
    turned = np.fft.rfft(audio_n, padded) * np.exp(2j * np.pi * frequencies * time_s)
    return np.fft.irfft(turned, padded)[..., :length].astype(np.float32)


def possible(repair: Repair, array: MicrophoneArray) -> bool:
    """Whether the repaired array is one."""
    try:
        repair.mend(np.zeros((1, array.num_microphones, 1), dtype=np.float32), array)
    except InputError:
        return False
    return True
