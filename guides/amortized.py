"""The amortised guide: two networks map a picture and a recording to the posterior of one clip (Sec. III-D).

::

    image --> visual network --> mu_kd --> w_kd ~ LogNormal(mu_kd, sigma_k^2)
                                             |
    x_tf  --> audio network  <---------------+
                    `--> pi_bar_k --> pi_k ~ Dir(beta pi_bar)
"""

import math

import pyro
import pyro.distributions as dist
import torch
import torch.nn.functional as F
from pyro.distributions import TorchDistribution
from pyro.nn import PyroModule
from torch import Tensor, nn

from avssl_pyro.guides.base import GuideParameters
from avssl_pyro.networks.audio import AudioNet
from avssl_pyro.networks.visual import VisualNet

# exp(+-20) spans more than any array resolves, and keeps products of weights inside float32.
LOG_WEIGHT_LIMIT = 20.0
# Dirichlet concentrations below this make float32 samples and digamma gradients overflow.
LEAST_CONCENTRATION = 1e-3


class DirectionGuide(PyroModule):
    """q(w | image) = LogNormal(mu, sigma_k^2) with mu from the visual network and sigma_k learned.

    Args:
        visual: network from an image to log-weights mu_bkd.
        initial_sigma: sigma_k before training.
        diffuse_class: whether a class with equal weights is added, for diffuse noise; without it, some of the visual
            network's classes take its place and no longer follow objects.
    """

    def __init__(self, visual: VisualNet, initial_sigma: float = 0.3, diffuse_class: bool = False) -> None:
        super().__init__()
        self.visual = visual
        self.diffuse_class = diffuse_class
        self.num_sources = visual.num_sources + diffuse_class
        self.log_sigma_k = nn.Parameter(torch.full((self.num_sources,), math.log(initial_sigma)))

    def log_weights(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        """mu_bkd of images (B, 3, I, J) and the 2-D activation maps it is pooled from."""
        mu_bkd, activation_bkij = self.visual(image_bcij)
        mu_bkd = mu_bkd.to(self.log_sigma_k.dtype).clamp(-LOG_WEIGHT_LIMIT, LOG_WEIGHT_LIMIT)
        if self.diffuse_class:
            mu_bkd = F.pad(mu_bkd, (0, 0, 0, 1))
            activation_bkij = F.pad(activation_bkij, (0, 0, 0, 0, 0, 1))
        return mu_bkd, activation_bkij

    def sigma(self, mu_bkd: Tensor) -> Tensor:
        """sigma_k spread over clips and directions, (B, K, D)."""
        return self.log_sigma_k.exp()[:, None].expand_as(mu_bkd)

    def direction_posterior(self, mu_bkd: Tensor) -> TorchDistribution:
        """q(w | image), batch_shape (B,), event_shape (K, D)."""
        return dist.LogNormal(mu_bkd, self.sigma(mu_bkd)).to_event(2)


class AmortizedGuide(DirectionGuide):
    """q(w | image) = LogNormal(mu, sigma_k^2) and q(pi | x, w) = Dir(beta * pi_bar), with sigma_k and beta learned.

    Args:
        visual: network from an image to log-weights mu_bkd.
        audio: network from a spectrogram and normalised weights to levels pi_bar_bk.
        initial_sigma, diffuse_class: as of :class:`DirectionGuide`.
        initial_beta: beta before training.

    >>> from avssl_pyro.acoustics.grid import DirectionGrid
    >>> from avssl_pyro.acoustics.presets import PRESETS
    >>> from avssl_pyro.acoustics.stft_config import StftConfig
    >>> steering_fdm = PRESETS["circle4"].steering_vectors(DirectionGrid(72), StftConfig().frequencies)
    >>> guide = AmortizedGuide(VisualNet(num_sources=4), AudioNet(steering_fdm.to(torch.complex64)))
    >>> x_bfmt = torch.ones(1, 257, 4, 10, dtype=torch.complex64)
    >>> guide.parameters_of(x_bfmt, torch.zeros(1, 3, 88, 288)).mu_bkd.shape
    torch.Size([1, 4, 72])
    """

    def __init__(
        self,
        visual: VisualNet,
        audio: AudioNet,
        initial_sigma: float = 0.3,
        initial_beta: float = 100.0,
        diffuse_class: bool = False,
    ) -> None:
        super().__init__(visual, initial_sigma, diffuse_class)
        self.audio = audio
        self.log_beta = nn.Parameter(torch.tensor(math.log(initial_beta)))

    def concentration(self, feature_bcdt: Tensor, w_bkd: Tensor) -> Tensor:
        """Concentrations of q(pi | x, w), (B..., K)."""
        level_bk = self.audio.levels(feature_bcdt, w_bkd / w_bkd.sum(-1, keepdim=True))
        # Networks may run in lower precision (autocast); a Dirichlet may not.
        level_bk = level_bk.to(self.log_beta.dtype)
        return (self.log_beta.exp() * level_bk).clamp_min(LEAST_CONCENTRATION)

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        mu_bkd, _ = self.log_weights(image_bcij)
        feature_bcdt = self.audio.direction_features(x_bfmt)
        with pyro.plate("clip", x_bfmt.shape[0], dim=-1):
            w_bkd = pyro.sample("direction_weights", self.direction_posterior(mu_bkd))
            pyro.sample("mixing_levels", dist.Dirichlet(self.concentration(feature_bcdt, w_bkd)))

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """The posterior's parameters with w at softmax(mu), Eq. (1), as used for localization."""
        mu_bkd, activation_bkij = self.log_weights(image_bcij)
        concentration_bk = self.concentration(self.audio.direction_features(x_bfmt), mu_bkd.softmax(-1))
        return GuideParameters(mu_bkd, self.sigma(mu_bkd), concentration_bk, activation_bkij)


class UniformLevelGuide(DirectionGuide):
    """q(w | image) as in :class:`DirectionGuide` and pi = 1/K: "w/o Aud" of the paper's Sec. IV, no audio network."""

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        mu_bkd, _ = self.log_weights(image_bcij)
        with pyro.plate("clip", x_bfmt.shape[0], dim=-1):
            pyro.sample("direction_weights", self.direction_posterior(mu_bkd))
            levels_k = mu_bkd.new_full((mu_bkd.shape[-2],), 1 / mu_bkd.shape[-2])
            pyro.sample("mixing_levels", dist.Delta(levels_k, event_dim=1))

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:  # noqa: ARG002
        """The posterior's parameters; equal, very large concentrations make the levels certain."""
        mu_bkd, activation_bkij = self.log_weights(image_bcij)
        concentration_bk = mu_bkd.new_full(mu_bkd.shape[:-1], 1 / torch.finfo(mu_bkd.dtype).eps)
        return GuideParameters(mu_bkd, self.sigma(mu_bkd), concentration_bk, activation_bkij)
