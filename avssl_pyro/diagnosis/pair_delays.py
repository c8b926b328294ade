"""Delays between all pairs of channels by GCC-PHAT (Knapp and Carter 1976).

The estimates do not depend on the array's positions.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt
from scipy import fft
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.steering_kinds import FreeFieldKind
from avssl_pyro.clip import SAMPLE_RATE

LONGEST_S = 0.25
BAND_HZ = (150.0, 6000.0)
# Peaks are exact to about a sample; near talkers and warm air change delays further.
MARGIN, MARGIN_S = 1.1, 1.5 / SAMPLE_RATE
# At low frequencies, delays around a rigid sphere are 1.5 times as long as in free field.
DETOUR = 1.5


@dataclass(frozen=True)
class PairDelays:
    """Delays of the strongest sound between all pairs of channels.

    Args:
        delay_bmm: delay of row relative to column in seconds, (B, M, M), antisymmetric.
    """

    delay_bmm: npt.NDArray[np.float64]

    @classmethod
    def of(cls, audio_bmn: npt.NDArray[np.float32]) -> "PairDelays":
        """Estimates the delays of excerpts (B, M, N) at 16 kHz, up to 0.25 s."""
        num_blocks, num_channels, length = audio_bmn.shape
        longest = min(round(LONGEST_S * SAMPLE_RATE), length // 2)
        padded = fft.next_fast_len(length + longest, real=True)
        spectrum_bmf = fft.rfft(audio_bmn, padded)
        frequencies_f = fft.rfftfreq(padded, 1 / SAMPLE_RATE)
        in_band_f = (frequencies_f >= BAND_HZ[0]) & (frequencies_f <= BAND_HZ[1])
        spectrum_bmf = np.where(in_band_f, spectrum_bmf / np.maximum(np.abs(spectrum_bmf), 1e-12), 0)
        delay_bmm = np.zeros((num_blocks, num_channels, num_channels))
        for first, second in combinations(range(num_channels), 2):
            correlation_bn = fft.irfft(spectrum_bmf[:, first] * spectrum_bmf[:, second].conj(), padded)
            near_bn = np.concatenate([correlation_bn[:, -longest:], correlation_bn[:, : longest + 1]], axis=1)
            delay_b = (np.abs(near_bn).argmax(axis=1) - longest) / SAMPLE_RATE
            delay_bmm[:, first, second], delay_bmm[:, second, first] = delay_b, -delay_b
        return cls(delay_bmm)

    def late_groups(self, array: MicrophoneArray) -> list[tuple[tuple[int, ...], float]]:
        """Returns groups of delayed channels with their delays in seconds.

        Delays are relative to the largest group. Two channels belong to one group when, in most excerpts, their delay
        is possible for sound across the array.
        """
        limit_mm = longest_delays(array)
        possible_mm = (np.abs(self.delay_bmm) <= limit_mm).mean(axis=0) > 0.5
        _, group_m = connected_components(possible_mm, directed=False)
        largest = int(np.bincount(group_m).argmax())
        reference = np.flatnonzero(group_m == largest)
        late = []
        for group in sorted(set(group_m.tolist()) - {largest}):
            members = np.flatnonzero(group_m == group)
            delay_s = float(np.median(self.delay_bmm[:, members[:, None], reference]))
            late.append((tuple(members.tolist()), delay_s))
        return late

    def scale(self, array: MicrophoneArray) -> float:
        """Estimates the ratio of the array's acoustic size to its positions.

        The sound is assumed to come from the horizon. For microphones spread evenly over the plane, sum_ij tau_ij^2 =
        M^2 tr(S) / 2c^2 at any azimuth, with S the covariance of their positions in the plane.
        """
        squared_s2 = float(np.median((self.delay_bmm**2).sum(axis=(1, 2))))
        plane_mx = array.positions[:, :2] - array.positions[:, :2].mean(axis=0)
        expected_s2 = array.num_microphones * float((plane_mx**2).sum()) / array.speed_of_sound**2
        return float(np.sqrt(squared_s2 / expected_s2)) if expected_s2 > 0 else 1.0


def longest_delays(array: MicrophoneArray) -> npt.NDArray[np.float64]:
    """Returns the longest possible delays across the array in seconds, (M, M).

    The delays include a margin.
    """
    distance_mm = cdist(array.positions, array.positions)
    detour = 1.0 if isinstance(array.steering, FreeFieldKind) else DETOUR
    return np.asarray(MARGIN * detour * distance_mm / array.speed_of_sound + MARGIN_S)
