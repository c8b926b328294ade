"""Simulation-based calibration of posteriors of a small model, of which hundreds can be drawn."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch
from attrs import evolve
from torch import Tensor, nn
from tqdm import tqdm

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.benchmarks.cache import ResultCache
from avssl_pyro.criticism.sbc import Sampler, Uniformity, rank_histogram, run_trials, uniformity
from avssl_pyro.evaluation.tables import Column, Table
from avssl_pyro.guides.gaussian_families import LowRank, MeanField
from avssl_pyro.guides.initializers import UninformedInitializer
from avssl_pyro.guides.nuts import NutsConfig, sample_posteriors
from avssl_pyro.guides.per_clip import PerClipConfig, PerClipGuide
from avssl_pyro.guides.posterior_draws import PosteriorDraws, draw_from
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.models.priors import LogNormalWeights, SymmetricDirichlet
from avssl_pyro.models.room import ROOM_DIFFUSE, Room
from avssl_pyro.models.spatial_cgmm import SpatialCGMM
from avssl_pyro.viz.plots import save_rank_histograms

ARRAY = PRESETS["circle4"]
LOWEST_HZ, HIGHEST_HZ = 500.0, 3000.0
FORMAT = "avssl-calibration/2"
REFINED, MEAN_FIELD, LOW_RANK, NUTS = "refined", "mean field", "low rank", "NUTS"
POSTERIORS = (REFINED, MEAN_FIELD, LOW_RANK, NUTS)


@dataclass(frozen=True)
class ToyModel:
    """A model small enough to be sampled hundreds of times, and guides of it.

    Args:
        num_sources, num_directions, num_bins, num_frames: K, D, F, T.
        alpha: concentration of the levels' symmetric Dirichlet; at 1 no class is likely to be silent.
        sigma: standard deviation of log w.
        draws: number of draws L of every posterior.
        thinning: number of draws of NUTS of which one is kept, so that those kept are nearly independent.
        warmup: number of warm-up steps of NUTS.
        room: whether every class has a share of diffuse sound.
    """

    num_sources: int = 2
    num_directions: int = 8
    num_bins: int = 6
    num_frames: int = 12
    alpha: float = 1.0
    sigma: float = 1.0
    draws: int = 49
    thinning: int = 2
    warmup: int = 60
    room: bool = False

    @property
    def grid(self) -> DirectionGrid:
        return DirectionGrid(self.num_directions)

    @property
    def frequencies_hz(self) -> npt.NDArray[np.float64]:
        return np.linspace(LOWEST_HZ, HIGHEST_HZ, self.num_bins)

    @property
    def steering_fdm(self) -> Tensor:
        """Four microphones, complex (F, D, M)."""
        return FreeField(ARRAY)(self.grid, self.frequencies_hz).to(torch.complex64)

    def model(self) -> SpatialCGMM:
        levels, directions = SymmetricDirichlet(self.alpha), LogNormalWeights(self.sigma)
        if not self.room:
            return SpatialCGMM(self.steering_fdm, self.num_sources, levels, directions)
        room = Room.of_array(ARRAY, self.grid, self.frequencies_hz)
        return SpatialCGMM(self.steering_fdm, self.num_sources, levels, directions, ROOM_DIFFUSE, room=room)

    def spectrogram(self) -> Tensor:
        """Zeros of the size of the data, complex (F, M, T)."""
        return torch.zeros(self.num_bins, self.steering_fdm.shape[-1], self.num_frames, dtype=torch.complex64)

    def refined(self) -> RefinedGuide:
        """Refinement from broad lobes, until it converges."""
        config = RefinementConfig(rounds=200, tolerance=1e-6, softening=1.0)
        return RefinedGuide(UninformedInitializer(self.num_sources, self.grid), self.model(), config)

    def samplers(self, steps: int = 100) -> dict[str, Sampler]:
        """Posteriors by name, from fast to slow; those fitted by gradients take ``steps``, low rank twice as many."""
        model, refined = self.model(), self.refined()
        mean_field = PerClipGuide(refined, model, MeanField(), PerClipConfig(steps))
        low_rank = PerClipGuide(mean_field, model, LowRank(rank=4), PerClipConfig(2 * steps))
        config = NutsConfig(draws=self.draws * self.thinning, warmup=self.warmup, chains=1)

        def by_guide(guide: nn.Module) -> Sampler:
            def sample(x_bfmt: Tensor, image_bcij: Tensor, seeds: Sequence[int]) -> list[PosteriorDraws]:
                clips = zip(x_bfmt, image_bcij, seeds, strict=True)
                return [draw_from(guide, x_fmt, image_cij, self.draws, seed) for x_fmt, image_cij, seed in clips]

            return sample

        def by_nuts(x_bfmt: Tensor, image_bcij: Tensor, seeds: Sequence[int]) -> list[PosteriorDraws]:
            clips = sample_posteriors(refined, model, x_bfmt, image_bcij, evolve(config, seed=seeds[0]))
            return [draws.thinned(self.thinning).float() for draws in clips]

        return {
            REFINED: by_guide(refined),
            MEAN_FIELD: by_guide(mean_field),
            LOW_RANK: by_guide(low_rank),
            NUTS: by_nuts,
        }


Ranks = Mapping[str, Mapping[str, list[int]]]
"""Ranks by posterior and quantity, one for each trial."""


@dataclass(frozen=True)
class CalibrationReport:
    """Ranks of prior draws among draws of several posteriors.

    Args:
        draws: number of draws L of each posterior.
        ranks: ranks 0..L.
    """

    draws: int
    ranks: Ranks

    @property
    def uniformity(self) -> dict[str, dict[str, Uniformity]]:
        """Uniformity of the ranks by posterior and quantity."""
        return {
            posterior: {name: uniformity(rank_n, self.draws) for name, rank_n in by_quantity.items()}
            for posterior, by_quantity in self.ranks.items()
        }

    def table(self) -> Table[str]:
        """One line for each quantity, one column for each posterior."""
        found = self.uniformity

        def shown(posterior: str, quantity: str) -> str:
            one = found[posterior][quantity]
            return f"{one.p_value:.2g} | {one.spread:.2f} | {one.shift:+.2f}"

        columns: list[Column[str]] = [Column("quantity", str), *(Column(p, partial(shown, p)) for p in found)]
        title = "p of uniform ranks | their spread (above 1: too narrow a posterior) | their shift (above 0: too low)"
        return Table(list(next(iter(found.values()))), columns, title)

    def write(self, folder: Path) -> None:
        """Writes ``ranks.json`` and ``ranks.png``.

        Raises:
            OSError: the folder cannot be written to.
        """
        found = self.uniformity
        content = {
            "draws": self.draws,
            "ranks": self.ranks,
            "uniformity": {p: {name: asdict(one) for name, one in rows.items()} for p, rows in found.items()},
        }
        write_atomically(folder / "ranks.json", json.dumps(content, indent=1).encode())
        save_rank_histograms(
            folder / "ranks.png",
            {p: {name: rank_histogram(r, self.draws) for name, r in rows.items()} for p, rows in self.ranks.items()},
            {p: {name: one.p_value for name, one in rows.items()} for p, rows in found.items()},
        )


def run_calibration(
    model: ToyModel, posteriors: Sequence[str], trials: int, batch: int, folder: Path, seed: int = 0
) -> CalibrationReport:
    """Ranks of all trials; batches of trials are stored in ``folder/trials`` and found again.

    Args:
        model: model and its guides.
        posteriors: names of :meth:`ToyModel.samplers`.
        trials: number of trials.
        batch: number of trials that are stored together.
        folder: folder of the results.
        seed: seed of the first trial; the others count up.

    Raises:
        InputError, OSError: a stored batch is damaged, or a new one cannot be written.
    """
    cache = ResultCache(folder / "trials", list[dict[str, int]], FORMAT)
    samplers = model.samplers()
    ranks: dict[str, dict[str, list[int]]] = {}
    for posterior in posteriors:
        rows: list[dict[str, int]] = []
        for start in tqdm(range(seed, seed + trials, batch), desc=posterior, unit="batch"):
            seeds = range(start, min(start + batch, seed + trials))
            run = partial(_ranks, model, posterior, samplers[posterior], seeds)
            settings = {"system": model, "posterior": posterior, "seeds": list(seeds)}
            rows += cache.get_or_run(f"{posterior.replace(' ', '-')}-{start:05d}", settings, run)
        ranks[posterior] = {name: [row[name] for row in rows] for name in rows[0]}
    return CalibrationReport(model.draws, ranks)


def _ranks(model: ToyModel, posterior: str, sampler: Sampler, seeds: Sequence[int]) -> list[dict[str, int]]:
    trials = run_trials(model.model(), {posterior: sampler}, model.spectrogram(), seeds)
    return [dict(trial[posterior]) for trial in trials]
