"""Guides fitted to single scenes by Pyro's autoguides, started at another guide's answer.

Nothing is amortised, and nothing is assumed of the model but its two latent sites, so any priors and any likelihood may
be behind them. Mean field asks how far each latent alone may move; low rank knows, too, which of them trade places.
"""

from dataclasses import dataclass
from typing import Protocol

import pyro
import torch
from pyro import poutine
from pyro.infer import Trace_ELBO
from torch import Tensor, nn

from avssl_pyro.distributions.seeded import seeded
from avssl_pyro.errors import InputError
from avssl_pyro.guides.amortized import LEAST_CONCENTRATION
from avssl_pyro.guides.base import GuideParameters
from avssl_pyro.guides.gaussian_families import ClipModel, GaussianFamily, MeanField
from avssl_pyro.guides.unconstrained_gaussian import UnconstrainedGaussian, log_normal_and_dirichlet
from avssl_pyro.models.explicit_masks import ExplicitMaskCGMM

# The last step of Adam relative to the first.
LAST_STEP = 0.05
LEVEL_DRAWS = 2000
# Log-weights begin so much narrower than their start, for the means to settle while draws are close to them.
FIRST_SPREAD = 0.3


class AnyGuide(Protocol):
    """What a guide is started from; it has to be a torch module."""

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """The posterior's parameters of a batch of clips."""
        ...


@dataclass(frozen=True)
class PerClipConfig:
    """How a guide is fitted to a scene.

    Args:
        steps: of Adam, one draw of the latents each.
        learning_rate: of the first step; it falls to a twentieth.
        seed: of the draws, the same for every clip.
    """

    steps: int = 100
    learning_rate: float = 0.15
    seed: int = 0

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise InputError(f"PerClipConfig: steps is {self.steps}; it must be at least 1.")
        if not self.learning_rate > 0:
            raise InputError(f"PerClipConfig: learning_rate is {self.learning_rate}; it must be positive.")


class FittedGuide(nn.Module):
    """A guide of the very clips it was fitted to; ``x_bfmt`` and ``image_bcij`` are not looked at again.

    Args:
        posterior: of B clips.
        activation_bkij: activation maps of the guide it was started from, (B, K, I', J').
        seed: of the draws behind the levels' concentrations.
    """

    fits_each_clip = True

    def __init__(self, posterior: UnconstrainedGaussian, activation_bkij: Tensor, seed: int = 0) -> None:
        super().__init__()
        self.posterior = posterior
        self.activation_bkij = activation_bkij
        self.seed = seed

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:  # noqa: ARG002
        with pyro.plate("clip", len(self.posterior.loc_bn), dim=-1):
            w_bkd = pyro.sample("direction_weights", self.posterior.direction_posterior())
            pyro.sample("mixing_levels", self.posterior.level_posterior(w_bkd))

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:  # noqa: ARG002
        """Means and standard deviations of log w, and the Dirichlet with the levels' means and summed variance."""
        posterior = self.posterior
        with seeded(self.seed, posterior.loc_bn.device):
            w_sbkd = posterior.direction_posterior().sample((LEVEL_DRAWS,))
            level_sbk = posterior.level_posterior(w_sbkd).sample()
        concentration_bk = dirichlet_of_moments(level_sbk)
        return GuideParameters(posterior.mu_bkd, posterior.sigma_bkd, concentration_bk, self.activation_bkij)


class PerClipGuide(nn.Module):
    """q(w, pi) of every clip fitted to that clip alone, under whatever model.

    Clips are fitted one by one with the same draws, so that none depends on its batch. Drawing from the guide fits
    it anew; where it is used more than once on the same clips, keep what :meth:`fitted_to` returns.

    Args:
        start: the guide whose answer is the start; it is not changed.
        model: of which the posterior is wanted; its latent sites must be those of ``SpatialCGMM``. Its parameters, if
            it has any, are those of a module; Pyro's global store is not looked into.
        family: ``MeanField()`` or ``LowRank(rank)``.
        config: how to fit.

    Raises:
        InputError: the model's masks are explicit.

    >>> from avssl_pyro.systems.pretrained import load_weights_of
    >>> system = load_weights_of("circle4")
    >>> PerClipGuide(system.guide, system.model, MeanField()).fits_each_clip
    True
    """

    fits_each_clip = True

    def __init__(
        self,
        start: AnyGuide,
        model: ClipModel,
        family: GaussianFamily = MeanField(),  # noqa: B008
        config: PerClipConfig = PerClipConfig(),
    ) -> None:
        super().__init__()
        if isinstance(model, ExplicitMaskCGMM):
            raise InputError(
                "PerClipGuide: ExplicitMaskCGMM has discrete masks, which no Gaussian can follow; fit to SpatialCGMM, "
                "whose masks are summed out, for the same posterior."
            )
        of_start, of_model = (getattr(each, "num_sources", None) for each in (start, model))
        if None not in (of_start, of_model) and of_start != of_model:
            raise InputError(
                f"PerClipGuide: the start has {of_start} source classes and the model {of_model}; give both the same."
            )
        self.model = model
        self.start = start
        self.family = family
        self.config = config

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        self.fitted_to(x_bfmt, image_bcij)(x_bfmt, image_bcij)

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """The fitted posterior's parameters."""
        return self.fitted_to(x_bfmt, image_bcij).parameters_of(x_bfmt, image_bcij)

    def fitted_to(self, x_bfmt: Tensor, image_bcij: Tensor) -> FittedGuide:
        """A guide of these clips.

        Raises:
            InputError: the model has other latent sites than ``direction_weights`` and ``mixing_levels``.
        """
        with torch.no_grad(), poutine.block():
            start = self.start.parameters_of(x_bfmt, image_bcij)
        gaussian = log_normal_and_dirichlet(start.mu_bkd, FIRST_SPREAD * start.sigma_bkd, start.concentration_bk)
        fits = [self._fit(gaussian.clip(b), x_bfmt[b : b + 1], image_bcij[b : b + 1]) for b in range(len(start.mu_bkd))]
        return FittedGuide(UnconstrainedGaussian.stack(fits), start.activation_bkij, self.config.seed)

    def _fit(self, start: UnconstrainedGaussian, x_bfmt: Tensor, image_bcij: Tensor) -> UnconstrainedGaussian:
        config = self.config
        # Handlers around this guide must not see the fit, nor Pyro's global store its parameters.
        with (
            poutine.block(),
            pyro.get_param_store().scope(),
            pyro.validation_enabled(False),
            seeded(config.seed, x_bfmt.device),
            torch.enable_grad(),
        ):
            autoguide = self.family.autoguide(self.model, start, x_bfmt, image_bcij)
            loss = Trace_ELBO()(self.model, autoguide)  # type: ignore[arg-type]
            optimizer = torch.optim.Adam(autoguide.parameters(), lr=config.learning_rate)
            schedule = torch.optim.lr_scheduler.ExponentialLR(optimizer, LAST_STEP ** (1 / config.steps))
            for _ in range(config.steps):
                optimizer.zero_grad()
                loss(x_bfmt, image_bcij).backward()
                optimizer.step()
                schedule.step()
            return self.family.posterior(autoguide, start.num_sources)


def dirichlet_of_moments(level_sbk: Tensor) -> Tensor:
    """Concentrations (B, K) of the Dirichlet with the means of draws (S, B, K) and the sum of their variances."""
    # Draws that are certain of one class leave differences that single precision rounds away.
    draw_sbk = level_sbk.double()
    mean_bk, variance_bk = draw_sbk.mean(0), draw_sbk.var(0)
    spread_b = variance_bk.sum(-1).clamp_min(torch.finfo(torch.float32).tiny)
    total_b = ((mean_bk * (1 - mean_bk)).sum(-1) / spread_b - 1).clamp_min(1.0)
    return (total_b[:, None] * mean_bk).clamp_min(LEAST_CONCENTRATION).to(level_sbk.dtype)
