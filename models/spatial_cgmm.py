"""The generative model of a multichannel spectrogram, from directions and levels of its sources (Sec. III-C).

::

      sigma_0 --> w_kd (K, D) --> H_fk --+
                                         +--> x_tf (F, M, T)
      alpha_0 --> pi_k (K,) -------------+
      `------------------ plate "clip", B -----------------'

    w_kd ~ LogNormal(0, sigma_0^2)          direction_weights, Eq. (11)
    pi   ~ Dir(alpha_0)                     mixing_levels
    H_fk = sum_d w_kd a_fd a_fd^H + eps I   Eq. (10), weights normalised to sum 1
    with a room also sum_c e_kc Gamma_fc   diffuse_weights, see avssl_pyro.models.room
    x_tf ~ sum_k pi_k N_C(0, lambda_tfk H_fk)   spectrogram, Eqs. (8), (15), (16)
"""

import pyro
import torch
from pyro.distributions import TorchDistribution
from pyro.nn import PyroModule
from torch import Tensor

from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.distributions.spatial_mixture import LEAST_DIFFUSE
from avssl_pyro.errors import InputError
from avssl_pyro.models.likelihoods import Likelihood, ProfiledGaussian
from avssl_pyro.models.priors import DirectionPrior, LevelPrior, LogNormalWeights, SparseDirichlet
from avssl_pyro.models.room import Room
from avssl_pyro.validators import at_least, positive


class SpatialCGMM(PyroModule):
    """p(w) p(pi) p(x | w, pi) of Eqs. (8)-(11), masks marginalised; by default power spectra are profiled out.

    Args:
        steering_fdm: steering vectors a_fd, complex (F, D, M); its precision is the model's.
        num_sources: number of classes K, an upper bound on the sources of a clip plus one for diffuse noise.
        level_prior: prior of pi (site ``mixing_levels``).
        direction_prior: prior of w (site ``direction_weights``).
        diffuse: eps of Eq. (10) relative to the summed weights, without unit.
        bin_weight: multiplicity of every observed time-frequency bin where others were left out (a subsampled plate);
            it balances the likelihood against the priors.
        likelihood: p(x | w, pi) (site ``spectrogram``).
        room: diffuse share of every class (site ``diffuse_weights``) and templates of the directions in place of those
            of ``steering_fdm``; None for the paper's model.

    Raises:
        InputError: a number is out of its range, or a prior or the room has another shape than the model.

    >>> import pyro
    >>> from avssl_pyro.acoustics.grid import DirectionGrid
    >>> from avssl_pyro.acoustics.presets import PRESETS
    >>> from avssl_pyro.acoustics.stft_config import StftConfig
    >>> steering_fdm = PRESETS["circle4"].steering_vectors(DirectionGrid(8), StftConfig().frequencies)
    >>> model = SpatialCGMM(steering_fdm, num_sources=3, level_prior=SparseDirichlet(0.1))
    >>> x_bfmt = torch.ones(1, 257, 4, 10, dtype=torch.complex128)
    >>> sites = pyro.poutine.trace(model).get_trace(x_bfmt, torch.zeros(1, 3, 88, 288)).nodes
    >>> sites["direction_weights"]["value"].shape, sites["mixing_levels"]["value"].shape
    (torch.Size([1, 3, 8]), torch.Size([1, 3]))
    """

    def __init__(
        self,
        steering_fdm: Tensor,
        num_sources: int = 4,
        level_prior: LevelPrior = SparseDirichlet(alpha=0.01),  # noqa: B008
        direction_prior: DirectionPrior = LogNormalWeights(sigma=1.0),  # noqa: B008
        diffuse: float = 0.1,
        bin_weight: float = 1.0,
        likelihood: Likelihood = ProfiledGaussian(),  # noqa: B008
        room: Room | None = None,
    ) -> None:
        super().__init__()
        at_least(1).check_value("SpatialCGMM", "num_sources", num_sources)
        at_least(LEAST_DIFFUSE[steering_fdm.dtype]).check_value("SpatialCGMM", "diffuse", diffuse)
        positive.check_value("SpatialCGMM", "bin_weight", bin_weight)
        self.num_sources = num_sources
        self.level_prior = level_prior
        self.direction_prior = direction_prior
        self.diffuse = diffuse
        self.bin_weight = bin_weight
        self.likelihood = likelihood
        self.room = room
        # Kept as real pairs: module.to(dtype) and the buffer broadcast of data parallelism mishandle complex buffers.
        self.template_pairs: Tensor
        template_dfmm = template_covariances(steering_fdm)
        if room is not None:
            if room.direction_dfmm.shape != template_dfmm.shape:
                raise InputError(
                    f"SpatialCGMM: the room's templates are {tuple(room.direction_dfmm.shape)}; those of the steering "
                    f"vectors are {tuple(template_dfmm.shape)}."
                )
            template_dfmm = room.template_jfmm.to(template_dfmm)
        self.register_buffer("template_pairs", torch.view_as_real(template_dfmm), persistent=False)
        self.num_directions = steering_fdm.shape[1]
        like, num_directions = self.template_pairs, self.num_directions
        _check_shape("level_prior", level_prior(num_sources, like), (num_sources,))
        _check_shape(
            "direction_prior", direction_prior(num_sources, num_directions, like), (num_sources, num_directions)
        )

    @property
    def template_dfmm(self) -> Tensor:
        """Templates G_fd = a_fd a_fd^H, complex (D, F, M, M); with a room its own, (D + C, F, M, M)."""
        return torch.view_as_complex(self.template_pairs)

    @property
    def num_diffuse(self) -> int:
        """Number of the room's diffuse components C, 0 without a room."""
        return 0 if self.room is None else self.room.num_components

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:  # noqa: ARG002
        like = self.template_pairs
        # Sums of a million log-likelihoods need full precision, also where the networks run in half.
        full_precision = torch.autocast(x_bfmt.device.type, enabled=False)
        with full_precision, pyro.plate("clip", x_bfmt.shape[0], dim=-1):
            w_bkd = pyro.sample("direction_weights", self.direction_prior(self.num_sources, self.num_directions, like))
            pi_bk = pyro.sample("mixing_levels", self.level_prior(self.num_sources, like))
            w_bkd = self._with_diffuse_weights(w_bkd)
            of_x = self.likelihood(self.template_dfmm, w_bkd, pi_bk, x_bfmt.shape[-1], self.diffuse)
            with pyro.poutine.scale(scale=self.bin_weight):
                pyro.sample("spectrogram", of_x, obs=x_bfmt)

    def _with_diffuse_weights(self, w_bkd: Tensor) -> Tensor:
        """Weights of all templates, those of the room's diffuse components last."""
        if self.room is None:
            return w_bkd
        e_bkc = pyro.sample("diffuse_weights", self.room.prior(self.num_sources, self.template_pairs))
        return torch.cat([w_bkd, e_bkc], dim=-1)


def _check_shape(role: str, prior: TorchDistribution, event_shape: tuple[int, ...]) -> None:
    if (tuple(prior.batch_shape), tuple(prior.event_shape)) != ((), event_shape):
        raise InputError(
            f"SpatialCGMM: {role} returned a distribution of batch shape {tuple(prior.batch_shape)} and event shape "
            f"{tuple(prior.event_shape)}; they must be () and {event_shape} (use 'to_event')."
        )
