"""Parameters and interfaces of all guides, and the base of guides fitted clip by clip."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple, Protocol, Self

import pyro
import pyro.distributions as dist
import torch
from pyro.distributions import TorchDistribution
from torch import Tensor, nn


class GuideParameters(NamedTuple):
    """Variational parameters of a batch of clips, with levels at the mean of w as in localization.

    Args:
        mu_bkd: means of log w, (B, K, D).
        sigma_bkd: standard deviations of log w, (B, K, D).
        concentration_bk: Dirichlet concentrations beta * pi_bar, (B, K).
        activation_bkij: 2-D activation maps of the visual network, (B, K, I', J').
        diffuse_mu_bkc, diffuse_sigma_bkc: means and standard deviations of log e, (B, K, C), where the model has
            diffuse weights.
    """

    mu_bkd: Tensor
    sigma_bkd: Tensor
    concentration_bk: Tensor
    activation_bkij: Tensor
    diffuse_mu_bkc: Tensor | None = None
    diffuse_sigma_bkc: Tensor | None = None


class Initializer(Protocol):
    """Start of a refinement: a trained guide or a fixed rule. It has to be a torch module."""

    def log_weights(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        """Log-weights mu_bkd and activation maps (B, K, I', J') of images (B, 3, I, J)."""
        ...


class PosteriorGuide(Protocol):
    """Interface of every guide in this package to localization; each is a torch module."""

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """Variational parameters of spectrograms (B, F, M, T) and images (B, 3, I, J)."""
        ...

    def to(self, device: torch.device) -> Self:
        """As of :class:`torch.nn.Module`."""
        ...

    def eval(self) -> Self:
        """As of :class:`torch.nn.Module`."""
        ...


class FixedGuide(nn.Module):
    """q(w) q(pi | w) of B clips whose posterior is known; the inputs of a call are ignored.

    Args:
        parameters: variational parameters of the clips.
        direction_posterior: q(w), batch_shape (B,), event_shape (K, D); by default LogNormal(mu, sigma^2).
        level_posterior: function from w to q(pi | w), event_shape (K,); by default Dir(concentration).
    """

    fits_each_clip = True

    def __init__(
        self,
        parameters: GuideParameters,
        direction_posterior: TorchDistribution | None = None,
        level_posterior: Callable[[Tensor], TorchDistribution] | None = None,
    ) -> None:
        super().__init__()
        self._parameters_of_clips = parameters
        mu_bkd, sigma_bkd, concentration_bk = parameters[:3]
        self._diffuse_posterior: TorchDistribution | None = None
        if parameters.diffuse_mu_bkc is not None:
            assert parameters.diffuse_sigma_bkc is not None
            self._diffuse_posterior = dist.LogNormal(parameters.diffuse_mu_bkc, parameters.diffuse_sigma_bkc).to_event(
                2
            )
        self._direction_posterior = direction_posterior or dist.LogNormal(mu_bkd, sigma_bkd).to_event(2)
        self._level_posterior = level_posterior or (lambda _: dist.Dirichlet(concentration_bk))

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:  # noqa: ARG002
        with pyro.plate("clip", len(self._parameters_of_clips.mu_bkd), dim=-1):
            w_bkd = pyro.sample("direction_weights", self._direction_posterior)
            pyro.sample("mixing_levels", self._level_posterior(w_bkd))
            if self._diffuse_posterior is not None:
                pyro.sample("diffuse_weights", self._diffuse_posterior)

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:  # noqa: ARG002
        """The known parameters."""
        return self._parameters_of_clips


class ClipFittedGuide(nn.Module, ABC):
    """A guide fitted to each clip alone: a call fits it anew, :meth:`fitted_to` keeps the fit."""

    fits_each_clip = True

    @abstractmethod
    def fitted_to(self, x_bfmt: Tensor, image_bcij: Tensor) -> FixedGuide:
        """Fits the guide to spectrograms (B, F, M, T) and images (B, 3, I, J)."""

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        self.fitted_to(x_bfmt, image_bcij)(x_bfmt, image_bcij)

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """The fitted posterior's parameters."""
        return self.fitted_to(x_bfmt, image_bcij).parameters_of(x_bfmt, image_bcij)
