"""The reference posterior of one clip: Hamiltonian Monte Carlo (NUTS, Hoffman and Gelman 2014) by Pyro's kernel.

It is slow, exact in the limit, and free of distribution families: a reference for the guides. Two properties of the
model matter. First, the likelihood does not depend on the scale of each w_k; along it the posterior is the prior, wide
but well behaved. Second, the likelihood does not depend on the order of the classes, so every mode has K! equal copies.
Chains start at the same point, the posterior of a guide. Between well separated classes they never cross from one copy
to another, and draws may be averaged class by class. Where classes are alike or empty they do cross, and only
quantities that do not depend on the order are meaningful: sorted levels, the power from a sector.
"""

import copy
import importlib.util
import warnings
from dataclasses import dataclass
from typing import Any

import pyro
import torch
from attrs import field, frozen
from pyro import poutine
from pyro.infer import NUTS
from torch import Tensor, nn
from tqdm import tqdm

from avssl_pyro.distributions.seeded import seeded
from avssl_pyro.errors import InputError
from avssl_pyro.guides.base import ClipFittedGuide, FixedGuide, GuideParameters, PosteriorGuide
from avssl_pyro.guides.diffuse_start import start_for
from avssl_pyro.guides.per_clip import dirichlet_of_moments
from avssl_pyro.guides.posterior_draws import PosteriorDraws
from avssl_pyro.guides.unconstrained_gaussian import UnconstrainedGaussian, log_normal_and_dirichlet
from avssl_pyro.validators import at_least, between

# Distance of chains from the start in standard deviations: apart, but in the same copy of the mode.
JITTER = 0.5
# Axes of the sites beside chain and draw, as ArviZ names them.
DIMS = {
    "direction_weights": ["source", "direction"],
    "mixing_levels": ["source"],
    "diffuse_weights": ["source", "component"],
}


@frozen
class NutsConfig:
    """Length and accuracy of the sampling.

    Args:
        draws: draws of every chain after its warm-up.
        warmup: discarded steps that adapt step size and mass matrix.
        chains: number of chains, run one after the other.
        max_tree_depth: depth of the trajectory tree; a draw costs at most 2^depth gradients.
        target_accept: acceptance rate; higher means smaller steps.
        seed: seed of the first chain; the others count up.
        progress: whether a bar is shown.
    """

    draws: int = field(default=250, validator=at_least(1))
    warmup: int = field(default=250, validator=at_least(1))
    chains: int = field(default=2, validator=at_least(1))
    max_tree_depth: int = field(default=7, validator=at_least(1))
    target_accept: float = field(default=0.8, validator=between(0, 1))
    seed: int = 0
    progress: bool = False


@dataclass(frozen=True)
class NutsDraws(PosteriorDraws):
    """Draws of all chains, one chain after the other.

    Args:
        chains: number of chains.
        diverging_s: whether the draw's trajectory diverged, (S,); more than a few make the draws unreliable.
        gradients: number of gradients computed, warm-up included.
    """

    chains: int
    diverging_s: Tensor
    gradients: int

    def by_chain(self, values_s: Tensor) -> Tensor:
        """Values (S, ...) of every draw as (chains, draws, ...)."""
        return values_s.unflatten(0, (self.chains, -1))

    def to_arviz(self) -> Any:
        """ArviZ's InferenceData: the sites of the model, and ``sample_stats.diverging``.

        Raises:
            InputError: ArviZ is not installed.
        """
        if importlib.util.find_spec("arviz") is None:
            raise InputError("ArviZ is not installed; pip install 'avssl-pyro[notebooks]' adds it.")
        with warnings.catch_warnings():
            # Once a day it announces its next version when it is imported.
            warnings.simplefilter("ignore", FutureWarning)
            import arviz  # noqa: PLC0415 - an optional dependency

        return arviz.from_dict(
            posterior={site: self.by_chain(value_s).numpy() for site, value_s in self.sites.items()},
            sample_stats={"diverging": self.by_chain(self.diverging_s).numpy()},
            dims={site: DIMS[site] for site in self.sites},
        )

    def moments(self) -> tuple[Tensor, Tensor, Tensor]:
        """Means and standard deviations (K, D) of log w, and concentrations (K,) of a Dirichlet like the levels."""
        log_w_skd = self.w_skd.log()
        return log_w_skd.mean(0), log_w_skd.std(0), dirichlet_of_moments(self.pi_sk[:, None])[0]

    def diffuse_moments(self) -> tuple[Tensor, Tensor] | None:
        """Means and standard deviations (K, C) of log e; None without a room."""
        if self.e_skc is None:
            return None
        log_e_skc = self.e_skc.log()
        return log_e_skc.mean(0), log_e_skc.std(0)


def sample_posterior(
    start: PosteriorGuide, model: nn.Module, x_fmt: Tensor, image_cij: Tensor, config: NutsConfig | None = None
) -> NutsDraws:
    """Draws from p(w, pi | x), with a room p(w, pi, e | x), of one clip, in double precision.

    Args:
        start: guide; chains begin near its mean, and its spread is the scale of the first mass matrix.
        model: model with the latent sites of ``SpatialCGMM``.
        x_fmt: spectrogram, complex (F, M, T).
        image_cij: picture, (3, I, J).
        config: length and accuracy.
    """
    (draws,) = sample_posteriors(start, model, x_fmt[None], image_cij[None], config)
    return draws


def sample_posteriors(
    start: PosteriorGuide, model: nn.Module, x_bfmt: Tensor, image_bcij: Tensor, config: NutsConfig | None = None
) -> list[NutsDraws]:
    """Draws of several clips at once, as :func:`sample_posterior` of each.

    Clips are independent, so a trajectory in the product of their posteriors is one in each. Its steps are somewhat
    shorter, but for small clips a gradient of many costs little more than one of a single clip. Steps, gradients and
    divergences are those of all clips together.

    Raises:
        InputError: start and model have different numbers of diffuse components.
    """
    config = NutsConfig() if config is None else config
    with torch.no_grad(), poutine.block():
        answer = start_for(model, start.parameters_of(x_bfmt, image_bcij), x_bfmt, image_bcij)
    # The log-likelihood has five to seven digits before the point, and acceptance depends on one after it.
    exact = answer.double()
    origin = log_normal_and_dirichlet(*exact[:3], exact.diffuse_mu_bkc, exact.diffuse_sigma_bkc)
    potential = ClipPotential(model, origin, x_bfmt, image_bcij)
    chains = [_run_chain(potential, config, chain) for chain in range(config.chains)]
    latent_sbn = potential.latent_of(torch.cat([draws_sbn for draws_sbn, _ in chains]))
    diverging_s = torch.cat([diverging_s for _, diverging_s in chains])
    sites, _ = origin.sites_of(latent_sbn)
    w_sbkd, pi_sbk, e_sbkc = sites["direction_weights"], sites["mixing_levels"], sites.get("diffuse_weights")
    return [
        NutsDraws(
            w_sbkd[:, b],
            pi_sbk[:, b],
            config.chains,
            diverging_s,
            potential.gradients,
            e_skc=None if e_sbkc is None else e_sbkc[:, b],
        )
        for b in range(len(x_bfmt))
    ]


class NutsGuide(ClipFittedGuide):
    """NUTS as a guide: log-normal weights and Dirichlet levels with the moments of its draws, clip by clip.

    Args:
        start, model, config: as of :func:`sample_posterior`.
    """

    def __init__(self, start: PosteriorGuide, model: nn.Module, config: NutsConfig | None = None) -> None:
        super().__init__()
        self.model = model
        self.start = start
        self.config = NutsConfig() if config is None else config

    def fitted_to(self, x_bfmt: Tensor, image_bcij: Tensor) -> FixedGuide:
        """Samples the posterior of these clips; activation maps are those of the start."""
        with torch.no_grad(), poutine.block():
            start = self.start.parameters_of(x_bfmt, image_bcij)
        draws = []
        for b, clip in enumerate(zip(x_bfmt, image_bcij, strict=True)):
            draws.append(sample_posterior(FixedGuide(start.clip(b)), self.model, *clip, self.config))
        known = [(*clip.moments(), *(clip.diffuse_moments() or ())) for clip in draws]
        moments = [torch.stack(values).to(start.mu_bkd) for values in zip(*known, strict=True)]
        return FixedGuide(GuideParameters._make([*moments[:3], start.activation_bkij, *(moments[3:] or (None, None))]))


class ClipPotential:
    """Minus the log of the joint density of clips over their unconstrained latents, in units of the origin's spreads.

    Args:
        model, x_bfmt, image_bcij: as of :func:`sample_posteriors`; the model is copied in double precision.
        origin: Gaussian whose mean is the zero of the latents and whose spread is their unit.
    """

    def __init__(self, model: nn.Module, origin: UnconstrainedGaussian, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        self.model = copy.deepcopy(model).double()
        self.origin = origin
        self.x_bfmt = x_bfmt.to(torch.complex128)
        self.image_bcij = image_bcij
        self.gradients = 0

    def latent_of(self, scaled_sbn: Tensor) -> Tensor:
        """Unconstrained latents, (..., B, N)."""
        return self.origin.loc_bn + self.origin.scale_bn * scaled_sbn

    def __call__(self, scaled: dict[str, Tensor]) -> Tensor:
        self.gradients += 1
        sites, jacobian_b = self.origin.sites_of(self.latent_of(scaled["latent"]))
        at_point = poutine.condition(self.model, data=sites)
        trace = poutine.trace(at_point).get_trace(self.x_bfmt, self.image_bcij)
        log_joint: Tensor = trace.log_prob_sum() + jacobian_b.sum()
        return -log_joint


def _run_chain(potential: ClipPotential, config: NutsConfig, chain: int) -> tuple[Tensor, Tensor]:
    """Draws (S, B, N) of one chain, and which of them diverged."""
    zero_bn = torch.zeros_like(potential.origin.loc_bn)
    # Far trajectories leave the support of distributions and are rejected.
    with (
        poutine.block(),
        pyro.validation_enabled(False),
        seeded(config.seed + chain, zero_bn.device),
        torch.enable_grad(),
    ):
        kernel = NUTS(
            potential_fn=potential,
            target_accept_prob=config.target_accept,
            max_tree_depth=config.max_tree_depth,
        )
        kernel.initial_params = {"latent": JITTER * torch.randn_like(zero_bn)}
        kernel.setup(config.warmup)
        scaled = kernel.initial_params
        draws = []
        steps = range(config.warmup + config.draws)
        for step in tqdm(steps, desc=f"chain {chain + 1}", unit="step", disable=not config.progress, leave=False):
            scaled = kernel.sample(scaled)
            if step >= config.warmup:
                draws.append(scaled["latent"].detach())
        diverging_s = torch.zeros(config.draws, dtype=torch.bool)
        diverging_s[kernel.diagnostics()["divergences"]] = True
        kernel.cleanup()
    return torch.stack(draws), diverging_s
