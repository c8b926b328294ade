"""The room as part of the model: every class has a share of sound without direction, beside its directions.

::

    e_kc ~ LogNormal(mean, sigma^2)      diffuse_weights, (K, C)
    H_fk = sum_d w_kd G_fd + sum_c e_kc Gamma_fc + eps I

The weights w and e of a class together sum to 1 before eps is added.
"""

import numpy as np
import numpy.typing as npt
import pyro.distributions as dist
import torch
from attrs import field, frozen
from pyro.distributions import TorchDistribution
from torch import Tensor

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.room_templates import (
    DiffuseComponent,
    IsotropicField,
    SensorNoise,
    elevated_templates,
)
from avssl_pyro.distributions.diffuse_prior import DirectionsAndDiffuse
from avssl_pyro.distributions.log_weight_priors import LogWeightPrior
from avssl_pyro.errors import InputError
from avssl_pyro.validators import positive

# A room has its own diffuse part, so eps only keeps H invertible.
ROOM_DIFFUSE = 0.01


@frozen(eq=False)
class Room:
    """Templates of directions and of diffuse sound, with the prior of the diffuse weights.

    Args:
        direction_dfmm: templates G_fd of the directions, complex (D, F, M, M), of any rank.
        diffuse_cfmm: spatial covariances of the diffuse components, complex (C, F, M, M), of the same trace.
        mean: prior mean of log e.
        sigma: prior standard deviation of log e.

    >>> from avssl_pyro.acoustics.presets import PRESETS
    >>> Room.of_array(PRESETS["circle4"], DirectionGrid(8), np.linspace(0, 8000, 5)).template_jfmm.shape
    torch.Size([10, 5, 4, 4])
    """

    direction_dfmm: Tensor
    diffuse_cfmm: Tensor
    mean: float = 2.0
    sigma: float = field(default=2.0, validator=positive)

    @classmethod
    def of_array(
        cls,
        array: MicrophoneArray,
        grid: DirectionGrid,
        frequencies_hz: npt.NDArray[np.float64],
        components: tuple[DiffuseComponent, ...] = (SensorNoise(), IsotropicField()),
        shares: tuple[tuple[float, float], ...] | None = None,
    ) -> "Room":
        """The room of an array in double precision.

        Args:
            array, grid, frequencies_hz: what templates are computed for.
            components: kinds of diffuse sound, at least one.
            shares: elevations in degrees and their shares, as of :func:`elevated_templates`.

        Raises:
            InputError: there is no component, or the array's response is not known in the directions needed.

        >>> from avssl_pyro.acoustics.presets import PRESETS
        >>> room = Room.of_array(PRESETS["circle4"], DirectionGrid(8), np.linspace(0, 8000, 5))
        >>> room.direction_dfmm.shape, room.num_components
        (torch.Size([8, 5, 4, 4]), 2)
        """
        if not components:
            raise InputError("Room.of_array: there is no diffuse component; give at least one, or a model no room.")
        diffuse_cfmm = torch.stack([component(array, frequencies_hz) for component in components])
        return cls(elevated_templates(array, grid, frequencies_hz, shares), diffuse_cfmm)

    @property
    def num_components(self) -> int:
        """Number of diffuse components C."""
        return len(self.diffuse_cfmm)

    @property
    def template_jfmm(self) -> Tensor:
        """Templates of directions, then of diffuse components, complex (D + C, F, M, M)."""
        return torch.cat([self.direction_dfmm, self.diffuse_cfmm])

    def prior(self, num_sources: int, like: Tensor) -> TorchDistribution:
        """p(e), event_shape (K, C), with dtype and device of ``like``."""
        mean_kc = like.new_full((num_sources, self.num_components), self.mean)
        return dist.LogNormal(mean_kc, like.new_full((), self.sigma)).to_event(2)

    def with_directions(self, prior: LogWeightPrior) -> LogWeightPrior:
        """The prior over log w and log e, one after the other."""
        return DirectionsAndDiffuse(prior, self.num_components, self.mean, self.sigma)
