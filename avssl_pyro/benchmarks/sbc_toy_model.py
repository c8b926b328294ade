"""The model and the posteriors that simulation-based calibration is run with: small, so that hundreds can be drawn."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor, nn

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.criticism.sbc import Sampler
from avssl_pyro.guides.gaussian_families import LowRank, MeanField
from avssl_pyro.guides.initializers import UninformedInitializer
from avssl_pyro.guides.nuts import NutsConfig, sample_posteriors
from avssl_pyro.guides.per_clip import PerClipConfig, PerClipGuide
from avssl_pyro.guides.posterior_draws import PosteriorDraws, draw_from
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.models.priors import LogNormalWeights, SymmetricDirichlet
from avssl_pyro.models.spatial_cgmm import SpatialCGMM

LOWEST_HZ, HIGHEST_HZ = 500.0, 3000.0
REFINED, MEAN_FIELD, LOW_RANK, NUTS = "refined", "mean field", "low rank", "NUTS"


@dataclass(frozen=True)
class SmallSystem:
    """A model small enough to be sampled hundreds of times.

    Args:
        num_sources, num_directions, num_bins, num_frames: K, D, F, T.
        alpha: concentration of the levels' symmetric Dirichlet; at 1 every class is likely to be heard.
        sigma: of log w.
        draws: L, of every posterior.
        thinning: every how many draws of NUTS is kept, so that they are nearly independent.
        warmup: of NUTS.
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

    @property
    def grid(self) -> DirectionGrid:
        return DirectionGrid(self.num_directions)

    @property
    def steering_fdm(self) -> Tensor:
        """Four microphones, complex (F, D, M)."""
        frequencies = np.linspace(LOWEST_HZ, HIGHEST_HZ, self.num_bins)
        return FreeField(PRESETS["circle4"])(self.grid, frequencies).to(torch.complex64)

    def model(self) -> SpatialCGMM:
        return SpatialCGMM(
            self.steering_fdm, self.num_sources, SymmetricDirichlet(self.alpha), LogNormalWeights(self.sigma)
        )

    def spectrogram(self) -> Tensor:
        """One of the right size, complex (F, M, T)."""
        return torch.zeros(self.num_bins, self.steering_fdm.shape[-1], self.num_frames, dtype=torch.complex64)

    def refined(self) -> RefinedGuide:
        """Started blind, and taken all the way."""
        config = RefinementConfig(rounds=200, tolerance=1e-6, softening=1.0)
        return RefinedGuide(UninformedInitializer(self.num_sources, self.grid), self.model(), config)

    def samplers(self, steps: int = 100) -> dict[str, Sampler]:
        """Posteriors by name, from quick to slow; those fitted by gradients take so many steps, low rank twice."""
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
            clips = sample_posteriors(refined, model, x_bfmt, image_bcij, replace(config, seed=seeds[0]))
            kept = slice(self.thinning - 1, None, self.thinning)
            return [PosteriorDraws(draws.w_skd[kept].float(), draws.pi_sk[kept].float()) for draws in clips]

        return {
            REFINED: by_guide(refined),
            MEAN_FIELD: by_guide(mean_field),
            LOW_RANK: by_guide(low_rank),
            NUTS: by_nuts,
        }
