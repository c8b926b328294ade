"""The amortised guide: two networks map a picture and a recording to the posterior of one clip (Sec. III-D).

::

    image --> visual network --> mu_kd --> w_kd ~ LogNormal(mu_kd, sigma_k^2)
                                             |
    x_tf  --> audio network  <---------------+
                    `--> pi_bar_k --> pi_k ~ Dir(beta pi_bar)

Where the model has a room, e_kc ~ LogNormal(log sum_d w_kd + r_kc, sigma_kc^2) for its diffuse components, with the
log ratio r from the audio network.
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
from avssl_pyro.networks.audio import INITIAL_DIFFUSE_RATIO, AudioNet
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
        num_diffuse: number of diffuse components of the model's room, 0 without a room.
    """

    def __init__(
        self, visual: VisualNet, initial_sigma: float = 0.3, diffuse_class: bool = False, num_diffuse: int = 0
    ) -> None:
        super().__init__()
        self.visual = visual
        self.diffuse_class = diffuse_class
        self.num_sources = visual.num_sources + diffuse_class
        self.log_sigma_k = nn.Parameter(torch.full((self.num_sources,), math.log(initial_sigma)))
        self.num_diffuse = num_diffuse
        if num_diffuse:
            self.diffuse_log_sigma_kc = nn.Parameter(
                torch.full((self.num_sources, num_diffuse), math.log(initial_sigma))
            )

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

    def sample_diffuse_weights(self, log_w_bkd: Tensor, log_ratio_bkc: Tensor) -> None:
        """Samples the site ``diffuse_weights``, event_shape (K, C), at given log-weights of the directions."""
        mu_bkc = diffuse_mu(log_w_bkd, log_ratio_bkc)
        pyro.sample("diffuse_weights", dist.LogNormal(mu_bkc, self.diffuse_log_sigma_kc.exp()).to_event(2))

    def with_diffuse(self, parameters: GuideParameters, log_ratio_bkc: Tensor) -> GuideParameters:
        """The parameters of a clip with those of log e at the mean of log w."""
        mu_bkc = diffuse_mu(parameters.mu_bkd, log_ratio_bkc)
        sigma_bkc = self.diffuse_log_sigma_kc.exp().expand_as(mu_bkc)
        return parameters._replace(diffuse_mu_bkc=mu_bkc, diffuse_sigma_bkc=sigma_bkc)


def diffuse_mu(log_w_bkd: Tensor, log_ratio_bkc: Tensor) -> Tensor:
    """Means of log e, (B, K, C): the log ratios relative to all directions of a class, whose scale is arbitrary."""
    return log_w_bkd.logsumexp(-1, keepdim=True) + log_ratio_bkc


class AmortizedGuide(DirectionGuide):
    """q(w | image) = LogNormal(mu, sigma_k^2) and q(pi | x, w) = Dir(beta * pi_bar), with sigma_k and beta learned.

    Args:
        visual: network from an image to log-weights mu_bkd.
        audio: network from a spectrogram and normalised weights to levels pi_bar_bk, and to the log ratios of the
            diffuse components of a model with a room.
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
        super().__init__(visual, initial_sigma, diffuse_class, audio.num_diffuse)
        self.audio = audio
        self.log_beta = nn.Parameter(torch.tensor(math.log(initial_beta)))

    def source_features(self, feature_bcdt: Tensor, w_bkd: Tensor) -> Tensor:
        """The audio network's features of every class, (B..., K, C), from those of directions and weights."""
        return self.audio.source_features(feature_bcdt, w_bkd / w_bkd.sum(-1, keepdim=True))

    def concentration(self, source_bkc: Tensor) -> Tensor:
        """Concentrations of q(pi | x, w), (B..., K)."""
        # Networks may run in lower precision (autocast); a Dirichlet may not.
        level_bk = self.audio.levels(source_bkc).to(self.log_beta.dtype)
        return (self.log_beta.exp() * level_bk).clamp_min(LEAST_CONCENTRATION)

    def log_diffuse_ratios(self, source_bkc: Tensor) -> Tensor:
        """Means of log e relative to the directions of a class, r of q(e | x, w), (B..., K, C)."""
        return self.audio.log_diffuse_ratios(source_bkc).to(self.log_beta.dtype)

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        mu_bkd, _ = self.log_weights(image_bcij)
        feature_bcdt = self.audio.direction_features(x_bfmt)
        with pyro.plate("clip", x_bfmt.shape[0], dim=-1):
            w_bkd = pyro.sample("direction_weights", self.direction_posterior(mu_bkd))
            source_bkc = self.source_features(feature_bcdt, w_bkd)
            pyro.sample("mixing_levels", dist.Dirichlet(self.concentration(source_bkc)))
            if self.num_diffuse:
                self.sample_diffuse_weights(w_bkd.log(), self.log_diffuse_ratios(source_bkc))

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """The posterior's parameters with w at softmax(mu), Eq. (1), as used for localization."""
        mu_bkd, activation_bkij = self.log_weights(image_bcij)
        source_bkc = self.source_features(self.audio.direction_features(x_bfmt), mu_bkd.softmax(-1))
        parameters = GuideParameters(mu_bkd, self.sigma(mu_bkd), self.concentration(source_bkc), activation_bkij)
        return self.with_diffuse(parameters, self.log_diffuse_ratios(source_bkc)) if self.num_diffuse else parameters


class UniformLevelGuide(DirectionGuide):
    """q(w | image) as in :class:`DirectionGuide` and pi = 1/K: "w/o Aud" of the paper's Sec. IV, no audio network.

    Args:
        visual, initial_sigma, diffuse_class, num_diffuse: as of :class:`DirectionGuide`; the log ratios of diffuse
            components are learned, and common to all clips.
    """

    def __init__(
        self, visual: VisualNet, initial_sigma: float = 0.3, diffuse_class: bool = False, num_diffuse: int = 0
    ) -> None:
        super().__init__(visual, initial_sigma, diffuse_class, num_diffuse)
        if num_diffuse:
            initial = math.log(INITIAL_DIFFUSE_RATIO / num_diffuse)
            self.log_diffuse_ratio_kc = nn.Parameter(torch.full((self.num_sources, num_diffuse), initial))

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        mu_bkd, _ = self.log_weights(image_bcij)
        with pyro.plate("clip", x_bfmt.shape[0], dim=-1):
            w_bkd = pyro.sample("direction_weights", self.direction_posterior(mu_bkd))
            levels_k = mu_bkd.new_full((mu_bkd.shape[-2],), 1 / mu_bkd.shape[-2])
            pyro.sample("mixing_levels", dist.Delta(levels_k, event_dim=1))
            if self.num_diffuse:
                self.sample_diffuse_weights(w_bkd.log(), self.log_diffuse_ratio_kc)

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:  # noqa: ARG002
        """The posterior's parameters; equal, very large concentrations make the levels certain."""
        mu_bkd, activation_bkij = self.log_weights(image_bcij)
        concentration_bk = mu_bkd.new_full(mu_bkd.shape[:-1], 1 / torch.finfo(mu_bkd.dtype).eps)
        parameters = GuideParameters(mu_bkd, self.sigma(mu_bkd), concentration_bk, activation_bkij)
        return self.with_diffuse(parameters, self.log_diffuse_ratio_kc) if self.num_diffuse else parameters
