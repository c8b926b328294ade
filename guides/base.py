"""What the guides have in common: the posterior of direction weights given the picture, q(w | image)."""

import math
from typing import NamedTuple, Protocol, Self

import pyro.distributions as dist
import torch
import torch.nn.functional as F
from pyro.nn import PyroModule
from torch import Tensor, nn

from avssl_pyro.networks.visual import VisualNet

# exp(+-20) spans more than any array resolves, and keeps products of weights inside float32.
LOG_WEIGHT_LIMIT = 20.0


class GuideParameters(NamedTuple):
    """Variational parameters of a batch of clips, at the mean of w as used for localization.

    Args:
        mu_bkd: means of log w, (B, K, D).
        sigma_bkd: standard deviations of log w, (B, K, D).
        concentration_bk: Dirichlet concentrations beta * pi_bar, (B, K).
        activation_bkij: 2-D activation maps of the visual network, (B, K, I', J').
    """

    mu_bkd: Tensor
    sigma_bkd: Tensor
    concentration_bk: Tensor
    activation_bkij: Tensor


class Initializer(Protocol):
    """Anything that says where to look first: a trained guide, or a rule of thumb. It has to be a torch module."""

    def log_weights(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        """Log-weights mu_bkd and activation maps (B, K, I', J') of images (B, 3, I, J)."""
        ...


class PosteriorGuide(Protocol):
    """A guide as localization sees it; every guide of this package is one, and each is a torch module."""

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """Variational parameters of spectrograms (B, F, M, T) and images (B, 3, I, J)."""
        ...

    def to(self, device: torch.device) -> Self:
        """As of :class:`torch.nn.Module`."""
        ...

    def eval(self) -> Self:
        """As of :class:`torch.nn.Module`."""
        ...


class DirectionGuide(PyroModule):
    """q(w | image) = LogNormal(mu, sigma_k^2) with mu from the visual network and sigma_k learned.

    Args:
        visual: maps an image to log-weights mu_bkd.
        initial_sigma: sigma_k before training.
        diffuse_class: add a class that looks everywhere alike, for diffuse noise; without it, some of the visual
            network's classes have to become that, and no longer follow objects.
    """

    def __init__(self, visual: VisualNet, initial_sigma: float = 0.3, diffuse_class: bool = False) -> None:
        super().__init__()
        self.visual = visual
        self.diffuse_class = diffuse_class
        self.num_sources = visual.num_sources + diffuse_class
        self.log_sigma_k = nn.Parameter(torch.full((self.num_sources,), math.log(initial_sigma)))

    def log_weights(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        """mu_bkd and the 2-D activation maps it was pooled from."""
        mu_bkd, activation_bkij = self.visual(image_bcij)
        mu_bkd = mu_bkd.to(self.log_sigma_k.dtype).clamp(-LOG_WEIGHT_LIMIT, LOG_WEIGHT_LIMIT)
        if self.diffuse_class:
            mu_bkd = F.pad(mu_bkd, (0, 0, 0, 1))
            activation_bkij = F.pad(activation_bkij, (0, 0, 0, 0, 0, 1))
        return mu_bkd, activation_bkij

    def sigma(self, mu_bkd: Tensor) -> Tensor:
        """sigma_k spread over clips and directions, (B, K, D)."""
        return self.log_sigma_k.exp()[:, None].expand_as(mu_bkd)

    def direction_posterior(self, mu_bkd: Tensor) -> dist.TorchDistribution:
        """q(w | image), batch_shape (B,), event_shape (K, D)."""
        return dist.LogNormal(mu_bkd, self.sigma(mu_bkd)).to_event(2)
