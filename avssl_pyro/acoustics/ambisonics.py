"""First-order ambisonics: four channels that differ in directivity, not in place."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.steering import normalized

# Where W, X, Y, Z stand among the four channels, and the gain of W and of X, Y, Z.
CHANNEL_ORDERS = {"acn": "WYZX", "fuma": "WXYZ"}
NORMALIZATIONS = {"sn3d": (1.0, 1.0), "n3d": (1.0, 3**0.5), "maxn": (0.5**0.5, 1.0)}


@dataclass(frozen=True)
class FirstOrderAmbisonics:
    """Plane waves encoded in first-order ambisonics: gains that depend on the direction, alike at all frequencies.

    With ACN order and SN3D normalization (ambiX) a source has the gains [1, sin az cos el, sin el, cos az cos el] in
    W, Y, Z, X.

    Args:
        order: ``acn`` (W, Y, Z, X) or ``fuma`` (W, X, Y, Z).
        normalization: ``sn3d``, ``n3d``, or ``maxn``, the one of FuMa files, whose W is 3 dB down.
    """

    order: str = "acn"
    normalization: str = "sn3d"

    def __call__(self, grid: DirectionGrid, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        return normalized(self.pressure(grid.unit_vectors, frequencies_hz))

    def pressure(
        self, unit_vectors_dx: npt.NDArray[np.float64], frequencies_hz: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.complex128]:
        omni, dipole = NORMALIZATIONS[self.normalization]
        x_d, y_d, z_d = dipole * unit_vectors_dx.T
        gain_d = {"W": np.full(len(unit_vectors_dx), omni), "X": x_d, "Y": y_d, "Z": z_d}
        gain_dm = np.stack([gain_d[channel] for channel in CHANNEL_ORDERS[self.order]], axis=-1)
        return np.tile(gain_dm.astype(np.complex128), (len(frequencies_hz), 1, 1))
