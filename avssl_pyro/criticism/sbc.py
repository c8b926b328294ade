"""Simulation-based calibration of posteriors (Talts et al. 2018, arXiv:1804.06788).

Draw latents from the prior, data from them, and L draws from the posterior of the data. If it is the true posterior,
the rank of any quantity of the first latents among the L is uniform over 0..L. A histogram like a U means a posterior
that is too narrow, one like a hill a posterior that is too wide, and a slope a bias.

The likelihood does not depend on the order of the source classes. The true posterior therefore contains every
permutation of a solution, while most approximations contain one. All quantities here are invariant under permutation:
sorted levels, power from a sector, averages over classes, and the likelihood. The likelihood is the most sensitive: as
a function of the data, it also detects posteriors that only return the prior (Modrak et al. 2023).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from scipy import stats
from torch import Tensor, nn

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.errors import InputError
from avssl_pyro.guides.conjugacy import WeighsBins
from avssl_pyro.guides.posterior_draws import PosteriorDraws, draw_log_likelihoods, prior_draws, replicate

SECTORS = ("ahead", "left", "behind", "right")
BINS = 10

Sampler = Callable[[Tensor, Tensor, Sequence[int]], list[PosteriorDraws]]
"""L draws from the posterior of every clip: spectrograms (B, F, M, T), pictures (B, 3, I, J), a seed for each."""

Ranks = Mapping[str, int]
"""The rank of every quantity, 0..L."""


@dataclass(frozen=True)
class Uniformity:
    """Uniformity of ranks.

    Args:
        p_value: p-value of a chi-square test over ``BINS`` bins.
        shift: mean of rank / L, minus a half; positive where the posterior lies below the truth.
        spread: standard deviation of the ranks over that of uniform ones; above 1 the posterior is too narrow.
        trials: number of ranks.
    """

    p_value: float
    shift: float
    spread: float
    trials: int


def quantities(model: nn.Module, x_fmt: Tensor, image_cij: Tensor, draws: PosteriorDraws) -> dict[str, Tensor]:
    """Quantities to rank by name, (S,) each; none depends on the order of the classes.

    Powers and sharpness are those of sound from directions, without the diffuse share of a model with a room.
    """
    share_skd = draws.w_skd / draws.w_skd.sum(-1, keepdim=True)
    power_sd = (draws.pi_sk[..., None] * share_skd).sum(-2)
    azimuth_d = DirectionGrid(power_sd.shape[-1]).azimuths
    sector_d = torch.from_numpy(np.round(azimuth_d / (np.pi / 2)).astype(np.int64) % len(SECTORS))
    return {
        "largest level": draws.pi_sk.amax(-1),
        **{f"power {name}": power_sd[:, sector_d == index].sum(-1) for index, name in enumerate(SECTORS[:3])},
        "sharpness": (draws.pi_sk * share_skd.amax(-1)).sum(-1),
        "mean log w": draws.w_skd.log().mean((-2, -1)),
        "log likelihood": draw_log_likelihoods(model, x_fmt, image_cij, draws),
    }


def run_trials(
    model: nn.Module, samplers: Mapping[str, Sampler], x_fmt: Tensor, seeds: Sequence[int]
) -> list[dict[str, Ranks]]:
    """Ranks of a prior draw in every posterior, by its name, for every seed.

    Args:
        model: model whose priors draw the truth and whose likelihood draws the data.
        samplers: posteriors by name.
        x_fmt: spectrogram of the size and precision of the data; its values do not matter.
        seeds: seeds of the trials, one each.

    Raises:
        InputError: bins of the model count other than once, so that no data can be drawn from it.
    """
    if (weight := getattr(model, "bin_weight", 1.0)) != 1:
        raise InputError(f"calibration: the model has bin_weight {weight}; data can be drawn from it only at 1.")
    if isinstance(likelihood := getattr(model, "likelihood", None), WeighsBins):
        raise InputError(
            f"calibration: {likelihood} weighs bins and is no density that data could be drawn from; use "
            "ProfiledGaussian, the density of every bin by itself."
        )
    image_cij = torch.zeros(3, 1, 1, dtype=x_fmt.real.dtype)
    # The same noise in truth, data and draws would make them agree.
    of_truth, of_data, of_draws = zip(*(_apart(seed) for seed in seeds), strict=True)
    truths = [prior_draws(model, x_fmt, image_cij, 1, seed) for seed in of_truth]
    x_bfmt = torch.cat(
        [replicate(model, x_fmt, image_cij, truth, seed) for truth, seed in zip(truths, of_data, strict=True)]
    )
    image_bcij = image_cij.expand(len(seeds), -1, -1, -1)
    draws = {name: sampler(x_bfmt, image_bcij, of_draws) for name, sampler in samplers.items()}
    return [
        {name: _ranks(model, x_bfmt[b], image_cij, truth, clips[b]) for name, clips in draws.items()}
        for b, truth in enumerate(truths)
    ]


def _apart(seed: int) -> list[int]:
    """Three seeds for one."""
    return [int(part) for part in np.random.SeedSequence(seed).generate_state(3)]


def _ranks(
    model: nn.Module, x_fmt: Tensor, image_cij: Tensor, truth: PosteriorDraws, draws: PosteriorDraws
) -> dict[str, int]:
    true_values, values = (quantities(model, x_fmt, image_cij, each) for each in (truth, draws))
    return {name: int((values[name] < true_values[name]).sum()) for name in values}


def uniformity(ranks: npt.ArrayLike, draws: int) -> Uniformity:
    """Tests ranks among ``draws`` draws.

    Raises:
        InputError: ranks 0..L do not fall into equal bins.
    """
    rank_n = np.asarray(ranks, dtype=np.int64)
    count_j = rank_histogram(rank_n, draws)
    uniform_std = np.sqrt((draws + 1) ** 2 - 1) / np.sqrt(12)
    return Uniformity(
        p_value=float(stats.chisquare(count_j).pvalue),
        shift=float(rank_n.mean() / draws - 0.5),
        spread=float(np.sqrt(np.mean((rank_n - draws / 2) ** 2)) / uniform_std),
        trials=len(rank_n),
    )


def rank_histogram(ranks: npt.ArrayLike, draws: int) -> npt.NDArray[np.int64]:
    """Counts of ranks 0..L in ``BINS`` equal bins."""
    if (draws + 1) % BINS:
        raise InputError(f"calibration: {draws} draws give {draws + 1} ranks; they must be a multiple of {BINS}.")
    rank_n = np.asarray(ranks, dtype=np.int64)
    return np.bincount(rank_n * BINS // (draws + 1), minlength=BINS)
