"""Priors, likelihoods and guides beside each other on the same clips: what each finds, and how good its bound is."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from torch import Tensor, nn

from avssl_pyro.benchmarks.comparison import Scene, tune_and_decide
from avssl_pyro.benchmarks.comparison import observe as observe_all
from avssl_pyro.benchmarks.posterior_method import PosteriorMethod
from avssl_pyro.criticism.compatibility import Combination, sampled_elbo
from avssl_pyro.distributions.profiled_gaussian import isotropic_log_likelihood, observe
from avssl_pyro.distributions.seeded import seeded
from avssl_pyro.evaluation.metrics import bootstrap_count_accuracy, bootstrap_f_measure, evaluate
from avssl_pyro.evaluation.tables import HEADLINE_TOLERANCE_DEG
from avssl_pyro.guides.base import GuideParameters
from avssl_pyro.guides.gaussian_families import LowRank, MeanField
from avssl_pyro.guides.per_clip import PerClipConfig, PerClipGuide
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.models.likelihoods import FrameActivity, InverseGammaPsd, Likelihood, ProfiledGaussian
from avssl_pyro.models.priors import (
    CircularWeights,
    DirectionPrior,
    GammaWeights,
    HalfNormalWeights,
    LevelPrior,
    LogisticNormal,
    LogNormalWeights,
    SparseDirichlet,
    SpikeAndSlabWeights,
    StickBreaking,
    SymmetricDirichlet,
)
from avssl_pyro.models.spatial_cgmm import SpatialCGMM
from avssl_pyro.systems.system import System

ELBO_DRAWS = 8
CLIPS_AT_A_TIME = 16
PER_SCENE = PerClipConfig(steps=60)

GuideMaker = Callable[[System, SpatialCGMM], Any]


def amortized(system: System, model: SpatialCGMM) -> nn.Module:  # noqa: ARG001
    """The networks' own answer, whatever the model."""
    guide: nn.Module = system.guide
    return guide


def refined(system: System, model: SpatialCGMM) -> RefinedGuide:
    """Closed-form ascent of the model's posterior from the networks' directions."""
    return RefinedGuide(system.guide, model)


def mean_field(system: System, model: SpatialCGMM) -> PerClipGuide:
    """Pyro's AutoNormal, from the refined posterior of the system's own model."""
    return PerClipGuide(RefinedGuide(system.guide, system.model), model, MeanField(), PER_SCENE)


def low_rank(system: System, model: SpatialCGMM) -> PerClipGuide:
    """Pyro's AutoLowRankMultivariateNormal, from the same start."""
    return PerClipGuide(RefinedGuide(system.guide, system.model), model, LowRank(), PER_SCENE)


@dataclass(frozen=True)
class Recipe:
    """A model and a guide by what they are made of.

    Args:
        levels, directions, likelihood: of the model; the rest of it is the system's.
        guide: makes the guide.
    """

    levels: LevelPrior = field(default_factory=SparseDirichlet)
    directions: DirectionPrior = field(default_factory=LogNormalWeights)
    likelihood: Likelihood = field(default_factory=ProfiledGaussian)
    guide: GuideMaker = refined

    @property
    def words(self) -> tuple[str, str, str, str]:
        """Guide, priors and likelihood as a table shows them."""
        return self.guide.__name__.replace("_", " "), str(self.levels), str(self.directions), str(self.likelihood)

    def build(self, system: System) -> Combination:
        """The combination on a system's array, with its sizes and networks.

        Raises:
            InputError: the parts do not fit together.
        """
        model = system.model_with(level_prior=self.levels, direction_prior=self.directions, likelihood=self.likelihood)
        return Combination(model, self.guide(system, model), sampled_elbo(ELBO_DRAWS))


RECIPES = (
    Recipe(guide=amortized),
    Recipe(),
    Recipe(levels=SymmetricDirichlet(1.0)),
    Recipe(levels=SymmetricDirichlet(100.0)),
    Recipe(directions=LogNormalWeights(0.3)),
    Recipe(directions=LogNormalWeights(0.5)),
    Recipe(directions=LogNormalWeights(2.0)),
    Recipe(directions=GammaWeights(0.5)),
    Recipe(directions=HalfNormalWeights()),
    Recipe(directions=SpikeAndSlabWeights()),
    Recipe(directions=CircularWeights(1.0, 10.0)),
    Recipe(directions=CircularWeights(2.0, 20.0)),
    Recipe(likelihood=InverseGammaPsd()),
    Recipe(directions=CircularWeights(2.0, 20.0), likelihood=InverseGammaPsd()),
    Recipe(guide=mean_field),
    Recipe(guide=low_rank),
    Recipe(levels=StickBreaking(), guide=mean_field),
    Recipe(levels=LogisticNormal(), guide=mean_field),
    Recipe(likelihood=FrameActivity(most_active=3), guide=mean_field),
)


@dataclass(frozen=True)
class CombinationRow:
    """How one recipe did.

    Args:
        guide, levels, directions, likelihood: what it was made of.
        f_measure, f_low, f_high: at the headline tolerance, with a 95 % interval.
        count_accuracy, count_low, count_high: share of clips with the right number of sources.
        elbo: mean evidence lower bound above the likelihood of noise from nowhere, nats per time-frequency bin; only
            those of one likelihood are comparable.
        ms_per_clip: of the guide, in batches of sixteen, milliseconds.
        thresholds: chosen on the validation clips.
    """

    guide: str
    levels: str
    directions: str
    likelihood: str
    f_measure: float
    f_low: float
    f_high: float
    count_accuracy: float
    count_low: float
    count_high: float
    elbo: float
    ms_per_clip: float
    thresholds: dict[str, float]

    @property
    def name(self) -> str:
        """The guide, and whatever is not as in the paper."""
        parts = zip((self.levels, self.directions, self.likelihood), Recipe().words[1:], strict=True)
        return ", ".join([self.guide, *(part for part, usual in parts if part != usual)])


class _Watched(nn.Module):
    """The guide of a combination, whose time is taken and whose ELBO is estimated while it localizes.

    Args:
        combination: whose guide answers.
        seed: of the ELBO's draws.
    """

    def __init__(self, combination: Combination, seed: int) -> None:
        super().__init__()
        self.guide = combination.guide
        self._combination = combination
        self._seed = seed
        self.seconds = 0.0
        self.elbos: list[float] = []

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        start = time.perf_counter()
        # A guide that fits every clip is fitted once for both uses.
        fitted = self.guide.fitted_to(x_bfmt, image_bcij) if hasattr(self.guide, "fitted_to") else self.guide
        parameters: GuideParameters = fitted.parameters_of(x_bfmt, image_bcij)
        self.seconds += time.perf_counter() - start
        with seeded(self._seed + len(self.elbos), x_bfmt.device):
            elbo = replace(self._combination, guide=fitted).elbo(x_bfmt, image_bcij)
        bins = math.prod(x_bfmt.shape[1::2])
        nowhere = float(isotropic_log_likelihood(observe(x_bfmt)).sum())
        elbo_gain = elbo / (bins * self._combination.model.bin_weight) - nowhere / bins
        self.elbos += [elbo_gain / len(x_bfmt)] * len(x_bfmt)
        return parameters


def run_recipe(
    recipe: Recipe, system: System, validation: Sequence[Scene], test: Sequence[Scene], seed: int = 0
) -> CombinationRow:
    """Tunes thresholds on the validation scenes, scores the test scenes, and estimates the ELBO of their clips.

    Raises:
        InputError: the parts of the recipe do not fit together, or a clip cannot be read.
    """
    combination = recipe.build(system)
    name, grid = "-".join(recipe.words), system.config.grid
    device = system.model.template_pairs.device
    watched = _Watched(combination, seed)
    tuning_method, method = (
        PosteriorMethod(name, Localizer(system, device, guide=guide).posteriors, grid, CLIPS_AT_A_TIME)
        for guide in (combination.guide, watched)
    )
    tuning, testing = observe_all([tuning_method], validation, "validation"), observe_all([method], test, "test")
    (run,) = tune_and_decide([method], tuning, testing, trivial=()).methods
    scores = evaluate(testing.references, run.estimates, np.deg2rad(HEADLINE_TOLERANCE_DEG))
    f_interval = bootstrap_f_measure(scores.tallies, seed)
    count_interval = bootstrap_count_accuracy(scores.tallies, seed)
    assert run.tuned is not None
    return CombinationRow(
        *recipe.words,
        f_measure=scores.f_measure,
        f_low=f_interval.low,
        f_high=f_interval.high,
        count_accuracy=scores.count_accuracy,
        count_low=count_interval.low,
        count_high=count_interval.high,
        elbo=float(np.mean(watched.elbos)),
        ms_per_clip=1e3 * watched.seconds / len(test),
        thresholds=asdict(run.tuned.setting),
    )
