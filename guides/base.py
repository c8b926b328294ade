"""Parameters and interfaces of all guides, and the base of guides fitted clip by clip."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple, Protocol, Self

import pyro
import pyro.distributions as dist
import torch
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

    @property
    def log_weights_bkj(self) -> Tensor:
        """Means of log w and, where there are diffuse weights, of log e, (B, K, D + C), as of a model's templates."""
        return self.mu_bkd if self.diffuse_mu_bkc is None else torch.cat([self.mu_bkd, self.diffuse_mu_bkc], dim=-1)

    def clip(self, b: int) -> "GuideParameters":
        """The parameters of one clip, still with an axis of clips."""
        return GuideParameters._make(None if value is None else value[b : b + 1] for value in self)

    def double(self) -> "GuideParameters":
        """The parameters in double precision."""
        return GuideParameters._make(None if value is None else value.double() for value in self)

    def sample_sites(self) -> None:
        """Samples independent sites in Pyro; the plate of clips is the caller's."""
        pyro.sample("direction_weights", dist.LogNormal(self.mu_bkd, self.sigma_bkd).to_event(2))
        pyro.sample("mixing_levels", dist.Dirichlet(self.concentration_bk))
        if self.diffuse_mu_bkc is not None:
            pyro.sample("diffuse_weights", dist.LogNormal(self.diffuse_mu_bkc, self.diffuse_sigma_bkc).to_event(2))


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
    """The posterior of B clips where it is known; the inputs of a call are ignored.

    Args:
        parameters: variational parameters of the clips.
        sample_sites: function that samples the sites in Pyro, each of batch_shape (B,); by default independent
            LogNormal(mu, sigma^2), Dir(concentration) and, with a room, LogNormal(diffuse_mu, diffuse_sigma^2).
    """

    fits_each_clip = True

    def __init__(self, parameters: GuideParameters, sample_sites: Callable[[], None] | None = None) -> None:
        super().__init__()
        self._parameters_of_clips = parameters
        self._sample_sites = sample_sites or parameters.sample_sites

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:  # noqa: ARG002
        with pyro.plate("clip", len(self._parameters_of_clips.mu_bkd), dim=-1):
            self._sample_sites()

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
