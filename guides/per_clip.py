"""Guides fitted to single clips by gradients (Pyro's autoguides), started at another guide's posterior.

They need the model's latent sites only, so they work with any priors, any likelihood and any room. Mean field fits
each latent apart; low rank adds correlations between latents.
"""

import pyro
import torch
from attrs import field, frozen
from pyro import poutine
from pyro.infer import Trace_ELBO
from torch import Tensor

from avssl_pyro.distributions.seeded import seeded
from avssl_pyro.errors import InputError
from avssl_pyro.guides.amortized import LEAST_CONCENTRATION
from avssl_pyro.guides.base import ClipFittedGuide, FixedGuide, GuideParameters, PosteriorGuide
from avssl_pyro.guides.diffuse_start import start_for
from avssl_pyro.guides.gaussian_families import ClipModel, GaussianFamily, MeanField
from avssl_pyro.guides.unconstrained_gaussian import UnconstrainedGaussian, log_normal_and_dirichlet
from avssl_pyro.models.explicit_masks import ExplicitMaskCGMM
from avssl_pyro.validators import at_least, positive

# The last step of Adam relative to the first.
LAST_STEP = 0.05
LEVEL_DRAWS = 2000
# Initial spread of log-weights relative to the start: means settle faster while draws are close to them.
FIRST_SPREAD = 0.3


@frozen
class PerClipConfig:
    """Settings of the optimiser.

    Args:
        steps: steps of Adam, one draw of the latents each.
        learning_rate: learning rate of the first step; it falls to a twentieth.
        seed: seed of the draws, the same for every clip.
    """

    steps: int = field(default=100, validator=at_least(1))
    learning_rate: float = field(default=0.15, validator=positive)
    seed: int = 0


class PerClipGuide(ClipFittedGuide):
    """q(w, pi) of every clip fitted to that clip alone, under any model.

    Clips are fitted one by one with the same draws, so that no result depends on its batch.

    Args:
        start: guide whose posterior is the start; it is not changed.
        model: model with the latent sites of ``SpatialCGMM``. Parameters, if any, are those of a module; Pyro's global
            store is not used.
        family: ``MeanField()`` or ``LowRank(rank)``.
        config: settings of the optimiser.

    Raises:
        InputError: the model's masks are explicit.

    >>> from avssl_pyro.systems.pretrained import load_weights_of
    >>> system = load_weights_of("circle4")
    >>> PerClipGuide(system.guide, system.model, MeanField()).fits_each_clip
    True
    """

    def __init__(
        self,
        start: PosteriorGuide,
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

    def fitted_to(self, x_bfmt: Tensor, image_bcij: Tensor) -> FixedGuide:
        """Fits the guide to these clips.

        Raises:
            InputError: the model has other latent sites than ``SpatialCGMM``, or another number of diffuse components
                than the start.
        """
        with torch.no_grad(), poutine.block():
            start = start_for(self.model, self.start.parameters_of(x_bfmt, image_bcij), x_bfmt, image_bcij)
        gaussian = log_normal_and_dirichlet(
            start.mu_bkd,
            FIRST_SPREAD * start.sigma_bkd,
            start.concentration_bk,
            start.diffuse_mu_bkc,
            None if start.diffuse_sigma_bkc is None else FIRST_SPREAD * start.diffuse_sigma_bkc,
        )
        fits = [self._fit(gaussian.clip(b), x_bfmt[b : b + 1], image_bcij[b : b + 1]) for b in range(len(start.mu_bkd))]
        posterior = UnconstrainedGaussian.stack(fits)
        # Levels are summarised by the Dirichlet with their means and their summed variance.
        with torch.no_grad(), seeded(self.config.seed, posterior.loc_bn.device):
            level_sbk = posterior.level_posterior(posterior.direction_posterior().sample((LEVEL_DRAWS,))).sample()
        parameters = GuideParameters(
            posterior.mu_bkd,
            posterior.sigma_bkd,
            dirichlet_of_moments(level_sbk),
            start.activation_bkij,
            posterior.diffuse_mu_bkc,
            posterior.diffuse_sigma_bkc,
        )
        return FixedGuide(parameters, posterior.sample_sites)

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
            return self.family.posterior(autoguide, start)


def dirichlet_of_moments(level_sbk: Tensor) -> Tensor:
    """Concentrations (B, K) of the Dirichlet with the means of draws (S, B, K) and the sum of their variances."""
    # Draws that are certain of one class leave differences that single precision rounds away.
    draw_sbk = level_sbk.double()
    mean_bk, variance_bk = draw_sbk.mean(0), draw_sbk.var(0)
    spread_b = variance_bk.sum(-1).clamp_min(torch.finfo(torch.float32).tiny)
    total_b = ((mean_bk * (1 - mean_bk)).sum(-1) / spread_b - 1).clamp_min(1.0)
    return (total_b[:, None] * mean_bk).clamp_min(LEAST_CONCENTRATION).to(level_sbk.dtype)
