"""Channels that are copies of each other, up to gain and sign."""

from itertools import combinations

import numpy as np

from avssl_pyro.diagnosis.finding import Finding, Severity, channels
from avssl_pyro.recordings.excerpts import Excerpts

CHECK = "duplicates"
# What is left of a channel, in power, when the best multiple of another one is taken away. Two microphones a
# centimetre apart keep a hundredth even without noise of their own; a copy keeps rounding errors.
COPY_RESIDUE = 1e-4
LEAST_POWER = 1e-20


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
    """Names the pairs of channels that hold one signal."""
    findings = [
        Finding(
            CHECK,
            Severity.ERROR,
            f"{channels([excerpts.names[first], excerpts.names[second]])} are copies of one signal",
            float(1 - 0.5 * residue / COPY_RESIDUE),
            "check the routing of the recorder; leave one of the two out of the array file",
        )
        for first, second, residue in find_duplicates(excerpts)
    ]
    return tuple(findings) or (Finding(CHECK, Severity.OK, "no two channels are copies", 1.0),)
