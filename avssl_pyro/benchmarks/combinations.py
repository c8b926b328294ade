"""Priors, likelihoods and guides on the same clips: scores, evidence lower bounds and times."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor, nn

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.benchmarks.cache import ResultCache
from avssl_pyro.benchmarks.comparison import LabeledClip, observe_scenes, tune_and_decide
from avssl_pyro.benchmarks.result_tables import HEADLINE_TOLERANCE_DEG
from avssl_pyro.criticism.compatibility import Combination, sampled_elbo
from avssl_pyro.datasets.dataset import LabeledClips
from avssl_pyro.distributions.profiled_gaussian import isotropic_log_likelihood, observe
from avssl_pyro.distributions.seeded import seeded
from avssl_pyro.evaluation.methods import PosteriorMethod
from avssl_pyro.evaluation.metrics import bootstrap_count_accuracy, bootstrap_f_measure, evaluate
from avssl_pyro.evaluation.tables import Column, Table
from avssl_pyro.guides.base import GuideParameters
from avssl_pyro.guides.gaussian_families import LowRank, MeanField
from avssl_pyro.guides.per_clip import PerClipConfig, PerClipGuide
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
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
from avssl_pyro.systems.checkpoint import fingerprint
from avssl_pyro.systems.system import System

ELBO_DRAWS = 8
CLIPS_AT_A_TIME = 16
# Counted up when the same settings lead to other numbers.
FORMAT = "avssl-combination/3"
PER_CLIP = PerClipConfig(steps=60)

GuideMaker = Callable[[System, SpatialCGMM], Any]


def amortized(system: System, model: SpatialCGMM) -> nn.Module:  # noqa: ARG001
    """Forward pass of the networks, whatever the model."""
    guide: nn.Module = system.guide
    return guide


def refined(system: System, model: SpatialCGMM) -> RefinedGuide:
    """MAP-EM of the model's posterior from the networks' directions."""
    return RefinedGuide(system.guide, model)


def mean_field(system: System, model: SpatialCGMM) -> PerClipGuide:
    """Pyro's AutoNormal, from the refined posterior of the system's own model."""
    return PerClipGuide(RefinedGuide(system.guide, system.model), model, MeanField(), PER_CLIP)


def low_rank(system: System, model: SpatialCGMM) -> PerClipGuide:
    """Pyro's AutoLowRankMultivariateNormal, from the same posterior."""
    return PerClipGuide(RefinedGuide(system.guide, system.model), model, LowRank(), PER_CLIP)


@dataclass(frozen=True)
class Recipe:
    """Parts of a model and a guide.

    Args:
        levels, directions, likelihood: parts of the model; the rest of it is the system's.
        guide: constructor of the guide.
    """

    levels: LevelPrior = field(default_factory=SparseDirichlet)
    directions: DirectionPrior = field(default_factory=LogNormalWeights)
    likelihood: Likelihood = field(default_factory=ProfiledGaussian)
    guide: GuideMaker = refined

    @property
    def words(self) -> tuple[str, str, str, str]:
        """Names of guide, priors and likelihood in tables."""
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


def recipes_for(system: System) -> tuple[Recipe, ...]:
    """``RECIPES`` with the system's own likelihood as the usual one, and the paper's beside it."""
    own, paper = system.model.likelihood, ProfiledGaussian()
    if own == paper:
        return RECIPES
    around = [replace(recipe, likelihood=own) if recipe.likelihood == paper else recipe for recipe in RECIPES]
    return (*around[:2], Recipe(), *around[2:])


@dataclass(frozen=True)
class CombinationRow:
    """Results of one recipe.

    Args:
        guide, levels, directions, likelihood: names of its parts.
        f_measure, f_low, f_high: F-measure at the headline tolerance, with a 95 % interval.
        count_accuracy, count_low, count_high: share of clips with the right number of sources, likewise.
        elbo: mean evidence lower bound above the likelihood of isotropic noise, nats per time-frequency bin; only
            those of one likelihood are comparable.
        ms_per_clip: time of the guide, in batches of sixteen, milliseconds.
        thresholds: thresholds chosen on the validation clips.
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

    def name(self, usual: Sequence[str]) -> str:
        """Name of the guide, and of the parts that differ from the usual ones."""
        parts = zip((self.levels, self.directions, self.likelihood), usual, strict=True)
        return ", ".join([self.guide, *(part for part, other in parts if part != other)])


class _MeasuredGuide(nn.Module):
    """Guide of a combination that measures its time and ELBO while it localizes.

    Args:
        combination: combination of the guide.
        seed: seed of the draws behind ELBOs.
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
        # A guide that is fitted to every clip is fitted once for both uses.
        fitted = self.guide.fitted_to(x_bfmt, image_bcij) if hasattr(self.guide, "fitted_to") else self.guide
        parameters: GuideParameters = fitted.parameters_of(x_bfmt, image_bcij)
        self.seconds += time.perf_counter() - start
        with seeded(self._seed + len(self.elbos), x_bfmt.device):
            elbo = replace(self._combination, guide=fitted).elbo(x_bfmt, image_bcij)
        bins = math.prod(x_bfmt.shape[1::2])
        isotropic = float(isotropic_log_likelihood(observe(x_bfmt)).sum())
        elbo_gain = elbo / (bins * self._combination.model.bin_weight) - isotropic / bins
        self.elbos += [elbo_gain / len(x_bfmt)] * len(x_bfmt)
        return parameters


def run_recipe(
    recipe: Recipe, system: System, validation: Sequence[LabeledClip], test: Sequence[LabeledClip], seed: int = 0
) -> CombinationRow:
    """Tunes thresholds on the validation scenes, scores the test scenes, and estimates the ELBO of their clips.

    Raises:
        InputError: the parts of the recipe do not fit together, or a clip cannot be read.
    """
    combination = recipe.build(system)
    name, grid = "-".join(recipe.words), system.config.grid
    device = system.model.template_pairs.device
    measured = _MeasuredGuide(combination, seed)
    tuning_method, method = (
        PosteriorMethod(name, Localizer(system, device, guide=guide).posteriors, grid, CLIPS_AT_A_TIME)
        for guide in (combination.guide, measured)
    )
    tuning, testing = observe_scenes([tuning_method], validation, "validation"), observe_scenes([method], test, "test")
    (run,) = tune_and_decide([method], tuning, testing, chance=()).methods
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
        elbo=float(np.mean(measured.elbos)),
        ms_per_clip=1e3 * measured.seconds / len(test),
        thresholds=asdict(run.tuned.setting),
    )


COLUMNS: tuple[Column[CombinationRow], ...] = (
    Column("F", lambda row: f"{row.f_measure:.3f} ({row.f_low:.2f}-{row.f_high:.2f})"),
    Column("count", lambda row: f"{row.count_accuracy:.3f} ({row.count_low:.2f}-{row.count_high:.2f})"),
    Column("ELBO", lambda row: row.elbo, "{:.4f}"),
    Column("ms/clip", lambda row: row.ms_per_clip, "{:.0f}"),
)


def run_combinations(
    recipes: Sequence[Recipe],
    system: System,
    sets: tuple[LabeledClips, LabeledClips],
    sizes: tuple[int, int],
    folder: Path,
    seed: int = 0,
) -> Table[CombinationRow]:
    """Runs what is not yet in ``folder/rows``, and writes ``combinations.json`` and ``combinations.md``.

    Args:
        recipes: combinations, in order; the first has the usual priors and likelihood.
        system: trained system.
        sets: scenes of validation and test.
        sizes: largest number of scenes of each.
        folder: folder of the results.
        seed: seed of the draws behind ELBOs and intervals.

    Raises:
        InputError, OSError: a stored row is damaged, or a file cannot be written.
    """
    cache = ResultCache(folder / "rows", CombinationRow, FORMAT)
    settings = {
        "guides": [RefinementConfig(), PER_CLIP, ELBO_DRAWS],
        "system": fingerprint(system),
        "sets": [scenes.fingerprint for scenes in sets],
        "scenes": sizes,
        "seed": seed,
    }
    validation, test = (scenes[:size] for scenes, size in zip(sets, sizes, strict=True))
    rows = []
    for number, recipe in enumerate(recipes, start=1):
        print(f"{number} of {len(recipes)}: {', '.join(recipe.words)}.", flush=True)
        facts = {**settings, "recipe": recipe.words}
        rows.append(cache.get_or_run("row", facts, partial(run_recipe, recipe, system, validation, test, seed)))
    usual = recipes[0].words[1:]
    columns = (Column("combination", lambda row: row.name(usual)), *COLUMNS)
    table = Table(rows, columns, notes=(f"If not said: {', '.join(usual)}.",))
    write_atomically(folder / "combinations.json", table.json().encode())
    write_atomically(folder / "combinations.md", replace(table, notes=()).markdown().encode())
    return table
