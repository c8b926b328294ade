"""Clipped channels: runs of samples at a channel's own extreme, whatever level that is."""

import numpy as np
import numpy.typing as npt

from avssl_pyro.diagnosis.finding import Finding, Severity, channels
from avssl_pyro.recordings.excerpts import Excerpts

CHECK = "clipping"
# A sine may touch its top with a sample or two, not with three again and again.
LEAST_RUN, LEAST_RUNS = 3, 4
SAME_LEVEL = 1e-4
# Below this a recording has so few levels that many samples share the highest by chance.
LEAST_EXTREME = 1e-2


def clipped_runs(samples_bn: npt.NDArray[np.float32]) -> tuple[int, float]:
    """Number of runs of at least three samples at the highest level, and that level; both ends, the worse one."""
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
    """Channels whose waveform is cut off flat."""
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
                Finding(CHECK, Severity.WARNING, found, confidence, "record with less gain; leave loud clips out")
            )
    return tuple(findings) or (Finding(CHECK, Severity.OK, "no channel is cut off", 0.9),)
