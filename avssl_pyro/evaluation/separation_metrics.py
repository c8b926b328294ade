"""The scale-invariant signal-to-distortion ratio of separated sound."""

import numpy as np
import numpy.typing as npt

# Of power: 100 dB in either direction.
LEAST_SHARE = 1e-10


def si_sdr(estimate_n: npt.NDArray[np.floating], reference_n: npt.NDArray[np.floating]) -> float:
    """10 log10 of the power of the estimate along the reference over that of the rest, dB (Le Roux et al. 2019).

    It is 20 log10 cot of the angle between the two signals, whatever their scales. It is limited to -100 and 100 dB;
    silence has -100 dB.
    """
    estimate_n, reference_n = estimate_n.astype(np.float64), reference_n.astype(np.float64)
    powers = float(estimate_n @ estimate_n) * float(reference_n @ reference_n)
    square_cosine = float(estimate_n @ reference_n) ** 2 / powers if powers > 0 else 0.0
    square_cosine = min(max(square_cosine, LEAST_SHARE), 1 - LEAST_SHARE)
    return float(10 * np.log10(square_cosine / (1 - square_cosine)))
