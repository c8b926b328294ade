"""Draws from the posterior of one clip under any guide, and their predictions."""

from dataclasses import dataclass, field
from typing import Any

import pyro
import torch
from pyro import poutine
from torch import Tensor, nn

from avssl_pyro.distributions.seeded import seeded
from avssl_pyro.distributions.spatial_mixture import SpatialMixture


@dataclass(frozen=True)
class PosteriorDraws:
    """Joint draws of the latents of one clip.

    Args:
        w_skd: direction weights, (S, K, D), positive.
        pi_sk: mixing levels, (S, K), summing to 1.
        e_skc: diffuse weights, (S, K, C), positive; None without a room.
    """

    w_skd: Tensor
    pi_sk: Tensor
    e_skc: Tensor | None = field(default=None, kw_only=True)

    def __len__(self) -> int:
        return len(self.pi_sk)

    def thinned(self, step: int) -> "PosteriorDraws":
        """One of every ``step`` draws."""
        kept = slice(step - 1, None, step)
        e_skc = None if self.e_skc is None else self.e_skc[kept]
        return PosteriorDraws(self.w_skd[kept], self.pi_sk[kept], e_skc=e_skc)

    def float(self) -> "PosteriorDraws":
        """The draws in single precision."""
        e_skc = None if self.e_skc is None else self.e_skc.float()
        return PosteriorDraws(self.w_skd.float(), self.pi_sk.float(), e_skc=e_skc)

    @property
    def sites(self) -> dict[str, Tensor]:
        """The draws by their site in the model, with the draws first."""
        sites = {"direction_weights": self.w_skd, "mixing_levels": self.pi_sk}
        return sites if self.e_skc is None else {**sites, "diffuse_weights": self.e_skc}


@torch.no_grad()
def draw_from(guide: nn.Module, x_fmt: Tensor, image_cij: Tensor, draws: int, seed: int = 0) -> PosteriorDraws:
    """Independent draws from a guide's posterior of one clip, all in one pass.

    Args:
        guide: guide of the sites ``direction_weights``, ``mixing_levels`` and, with a room, ``diffuse_weights``.
        x_fmt: spectrogram, complex (F, M, T).
        image_cij: picture, (3, I, J).
        draws: number of draws S.
        seed: seed of the draws.
    """
    with seeded(seed, x_fmt.device), poutine.block(), poutine.trace() as tracer, pyro.plate("draws", draws, dim=-2):
        guide(x_fmt[None], image_cij[None])
    nodes: Any = tracer.trace.nodes
    w_sbkd, pi_sbk = (nodes[site]["value"] for site in ("direction_weights", "mixing_levels"))
    e_sbkc = nodes["diffuse_weights"]["value"] if "diffuse_weights" in nodes else None
    # A site that does not depend on the others may be drawn once for all of them.
    return PosteriorDraws(
        w_sbkd.expand(draws, 1, -1, -1)[:, 0],
        pi_sbk.expand(draws, 1, -1)[:, 0],
        e_skc=None if e_sbkc is None else e_sbkc.expand(draws, 1, -1, -1)[:, 0],
    )


@torch.no_grad()
def prior_draws(model: nn.Module, x_fmt: Tensor, image_cij: Tensor, draws: int, seed: int = 0) -> PosteriorDraws:
    """Independent draws from a model's priors; of ``x_fmt`` only the shape matters."""
    return draw_from(model, x_fmt, image_cij, draws, seed)


@torch.no_grad()
def draw_log_likelihoods(model: nn.Module, x_fmt: Tensor, image_cij: Tensor, draws: PosteriorDraws) -> Tensor:
    """log p(x | w, pi) of every draw, (S,), with the model's bin weight; with a room, given its diffuse weights too."""
    likelihood = _likelihood(model, x_fmt, image_cij, draws)
    return likelihood["scale"] * likelihood["fn"].log_prob(x_fmt[None]).expand(len(draws), 1)[:, 0]


@torch.no_grad()
def replicate(model: nn.Module, x_fmt: Tensor, image_cij: Tensor, draws: PosteriorDraws, seed: int = 0) -> Tensor:
    """One spectrogram like ``x_fmt`` from every draw, (S, F, M, T), drawn from the model.

    Where the power spectral density is profiled out it is set to 1: the profiled density is, up to a constant, that of
    the direction ``x / |x|`` alone (a complex angular central Gaussian), which no power spectral density changes so
    long as it is the same for all classes. Statistics of such spectrograms must not depend on their power.

    A likelihood that weighs bins (``PrecedenceGaussian``) is no density of a whole spectrogram. Its replicas are those
    of ``ProfiledGaussian``, the density of every bin by itself.
    """
    mixture = _likelihood(model, x_fmt, image_cij, draws)["fn"]
    if isinstance(mixture, SpatialMixture) and not mixture.can_be_sampled:
        f, _, t = x_fmt.shape
        mixture = mixture.with_psd(torch.ones(f, mixture.pi.shape[-1], t).to(mixture.pi))
    with seeded(seed, x_fmt.device):
        x_sbfmt: Tensor = mixture.sample()
    return x_sbfmt.expand(len(draws), 1, *x_fmt.shape)[:, 0]


def _likelihood(model: nn.Module, x_fmt: Tensor, image_cij: Tensor, draws: PosteriorDraws) -> Any:
    """The site of the spectrogram at the given draws."""
    # NUTS draws in double precision, which the model's templates need not have.
    latents = {site: value_s[:, None].to(x_fmt.real.dtype) for site, value_s in draws.sites.items()}
    at_draws = poutine.condition(model, data=latents)
    with poutine.block(), poutine.trace() as tracer, pyro.plate("draws", len(draws), dim=-2):
        at_draws(x_fmt[None], image_cij[None])
    return tracer.trace.nodes["spectrogram"]
