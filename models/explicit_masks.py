"""The generative model with time-frequency masks as latent variables (Eqs. 5, 6), for exact enumeration.

::

    clip    (dim -1):  w_kd, pi_k
    frame   (dim -2) x frequency (dim -3):  z_tf ~ Cat(pi),  x_tf | z_tf ~ N_C(0, lambda H_fz)

Marginalising z with ``TraceEnum_ELBO`` must agree with :class:`SpatialCGMM`. Plain complex algebra makes the two
independent.
"""

import math
from typing import Any, ClassVar

import pyro
import pyro.distributions as dist
import torch
from pyro.distributions import TorchDistribution
from pyro.ops.indexing import Vindex
from torch import Size, Tensor
from torch.distributions import constraints

from avssl_pyro.distributions.profiled_gaussian import RELATIVE_POWER_FLOOR
from avssl_pyro.errors import InputError, name_of
from avssl_pyro.models.likelihoods import ProfiledGaussian
from avssl_pyro.models.spatial_cgmm import SpatialCGMM


class ProfiledBin(TorchDistribution):
    """N_C(0, lambda H) of one time-frequency bin with lambda at its maximum-likelihood value (Eqs. 7, 16).

    Args:
        precision: inverse covariance H^-1, complex (..., M, M).
        logdet: log determinant of H, (...).
        power_floor: power added to lambda, (...).
    """

    arg_constraints: ClassVar[dict[str, constraints.Constraint]] = {}
    support = constraints.independent(constraints.real, 1)

    def __init__(self, precision: Tensor, logdet: Tensor, power_floor: Tensor) -> None:
        self.precision, self.logdet, self.power_floor = precision, logdet, power_floor
        super().__init__(
            torch.broadcast_shapes(logdet.shape, power_floor.shape), Size(precision.shape[-1:]), validate_args=False
        )

    def expand(self, batch_shape: Any, _instance: Any = None) -> "ProfiledBin":
        m = self.event_shape[0]
        return ProfiledBin(
            self.precision.expand(*batch_shape, m, m),
            self.logdet.expand(batch_shape),
            self.power_floor.expand(batch_shape),
        )

    def log_prob(self, value: Tensor) -> Tensor:
        m = self.event_shape[0]
        quad = torch.einsum("...m,...mn,...n->...", value.conj(), self.precision, value).real
        return -m * torch.log(math.pi * (quad / m + self.power_floor)) - self.logdet - m


class ExplicitMaskCGMM(SpatialCGMM):
    """:class:`SpatialCGMM` with a ``mask`` site per time-frequency bin; memory-hungry, for tests and small clips.

    Takes the arguments of :class:`SpatialCGMM`; the likelihood must be the paper's.

    Raises:
        InputError: the likelihood is another one.
    """

    def __init__(self, steering_fdm: Tensor, *args: Any, **kwargs: Any) -> None:
        super().__init__(steering_fdm, *args, **kwargs)
        if not isinstance(self.likelihood, ProfiledGaussian):
            raise InputError(
                f"ExplicitMaskCGMM: bins are independent given their masks under ProfiledGaussian alone, not under "
                f"{name_of(self.likelihood)}; use SpatialCGMM, which has its masks summed out."
            )
        self.steering_pairs: Tensor
        self.register_buffer("steering_pairs", torch.view_as_real(steering_fdm), persistent=False)

    def _covariances(self, w_bkd: Tensor) -> Tensor:
        """H_fk without eps, complex (F, B, K, M, M)."""
        share_bkd = (w_bkd / w_bkd.sum(-1, keepdim=True)).to(self.template_dfmm.dtype)
        if self.room is not None:
            return torch.einsum("bkd,dfmn->fbkmn", share_bkd, self.template_dfmm)
        steering_fdm = torch.view_as_complex(self.steering_pairs)
        return torch.einsum("bkd,fdm,fdn->fbkmn", share_bkd, steering_fdm, steering_fdm.conj())

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:  # noqa: ARG002
        like = self.steering_pairs
        f, d, m, _ = like.shape
        b, t = x_bfmt.shape[0], x_bfmt.shape[-1]
        clip_plate = pyro.plate("clip", b, dim=-1)
        frame_plate = pyro.plate("frame", t, dim=-2)
        frequency_plate = pyro.plate("frequency", f, dim=-3)
        with clip_plate:
            w_bkd = pyro.sample("direction_weights", self.direction_prior(self.num_sources, d, like))
            pi_bk = pyro.sample("mixing_levels", self.level_prior(self.num_sources, like))
            w_bkd = self._with_diffuse_weights(w_bkd)
        scm_fbkmn = self._covariances(w_bkd)
        scm_fbkmn = scm_fbkmn + self.diffuse * torch.eye(m, dtype=scm_fbkmn.dtype, device=scm_fbkmn.device)
        precision_f1bkmn = torch.linalg.inv(scm_fbkmn)[:, None]
        logdet_f1bk = torch.linalg.slogdet(scm_fbkmn).logabsdet[:, None]
        floor_b = RELATIVE_POWER_FLOOR * x_bfmt.abs().square().mean((1, 2, 3))
        x_ftbm = x_bfmt.permute(1, 3, 0, 2)
        with pyro.poutine.scale(scale=self.bin_weight), clip_plate, frame_plate, frequency_plate:
            z_ftb = pyro.sample("mask", dist.Categorical(pi_bk), infer={"enumerate": "parallel"})
            precision = Vindex(precision_f1bkmn)[..., z_ftb, :, :]
            logdet = Vindex(logdet_f1bk)[..., z_ftb]
            pyro.sample("spectrogram", ProfiledBin(precision, logdet, floor_b), obs=x_ftbm)
