"""The contract: every pair of prior, likelihood, guide and estimator runs, or is refused with a reason."""

import itertools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pyro
import pytest
import torch
from pyro.infer import ELBO, RenyiELBO, Trace_ELBO, TraceEnum_ELBO, TraceMeanField_ELBO
from torch import Tensor, nn

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.criticism.compatibility import Combination
from avssl_pyro.errors import InputError
from avssl_pyro.guides.amortized import AmortizedGuide, UniformLevelGuide
from avssl_pyro.guides.gaussian_families import LowRank, MeanField
from avssl_pyro.guides.per_clip import PerClipConfig, PerClipGuide
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.guides.unconstrained_gaussian import log_normal_and_dirichlet
from avssl_pyro.models.explicit_masks import ExplicitMaskCGMM
from avssl_pyro.models.likelihoods import FrameActivity, InverseGammaPsd, PrecedenceGaussian, ProfiledGaussian
from avssl_pyro.models.priors import (
    CircularWeights,
    GammaWeights,
    HalfNormalWeights,
    LogisticNormal,
    LogNormalWeights,
    SparseDirichlet,
    SpikeAndSlabWeights,
    StickBreaking,
    SymmetricDirichlet,
)
from avssl_pyro.models.room import ROOM_DIFFUSE, Room
from avssl_pyro.models.spatial_cgmm import SpatialCGMM
from avssl_pyro.networks.audio import AudioNet
from avssl_pyro.networks.visual import VisualNet
from avssl_pyro.training.elbo_terms import has_analytic_kl

B, D, K, T = 2, 8, 3, 4
GRID, FREQUENCIES = DirectionGrid(D), np.array([500.0, 1000.0, 2000.0])
STEERING_FDM = FreeField(PRESETS["circle4"])(GRID, FREQUENCIES).to(torch.complex64)
ROOM = Room.of_array(PRESETS["circle4"], GRID, FREQUENCIES)
STEPS = PerClipConfig(steps=2)


def with_room(*args: Any, **kwargs: Any) -> SpatialCGMM:
    return SpatialCGMM(*args, **kwargs, diffuse=ROOM_DIFFUSE, room=ROOM)


def explicit_with_room(*args: Any, **kwargs: Any) -> ExplicitMaskCGMM:
    return ExplicitMaskCGMM(*args, **kwargs, diffuse=ROOM_DIFFUSE, room=ROOM)


def num_diffuse(model: SpatialCGMM | None) -> int:
    return model.room.num_components if model is not None and model.room is not None else 0


def amortized(model: SpatialCGMM | None = None) -> AmortizedGuide:
    audio = AudioNet(STEERING_FDM, channels=4, num_diffuse=num_diffuse(model))
    return AmortizedGuide(VisualNet(K, D, channels=(4, 4)), audio).eval()


def uniform(model: SpatialCGMM) -> UniformLevelGuide:
    return UniformLevelGuide(VisualNet(K, D, channels=(4, 4)), num_diffuse=num_diffuse(model)).eval()


def refined(model: SpatialCGMM) -> RefinedGuide:
    return RefinedGuide(amortized(), model, RefinementConfig(rounds=2))


def mean_field(model: SpatialCGMM) -> PerClipGuide:
    return PerClipGuide(amortized(model), model, MeanField(), STEPS)


def low_rank(model: SpatialCGMM) -> PerClipGuide:
    """From a start without diffuse weights."""
    return PerClipGuide(amortized(), model, LowRank(2), STEPS)


class Choice(NamedTuple):
    """One of each."""

    levels: Any = SparseDirichlet()
    directions: Any = LogNormalWeights()
    likelihood: Any = ProfiledGaussian()
    model: Callable[..., SpatialCGMM] = SpatialCGMM
    guide: Callable[[SpatialCGMM], nn.Module] = amortized
    estimator: Callable[[], ELBO] = Trace_ELBO


FACTORS: dict[str, list[Any]] = {
    "levels": [SparseDirichlet(), SymmetricDirichlet(), StickBreaking(), LogisticNormal()],
    "directions": [
        LogNormalWeights(),
        GammaWeights(),
        HalfNormalWeights(),
        SpikeAndSlabWeights(),
        CircularWeights(width_deg=60.0),
    ],
    "likelihood": [ProfiledGaussian(), PrecedenceGaussian(), InverseGammaPsd(), FrameActivity()],
    "model": [SpatialCGMM, with_room, ExplicitMaskCGMM, explicit_with_room],
    "guide": [amortized, uniform, refined, mean_field, low_rank],
    "estimator": [Trace_ELBO, TraceMeanField_ELBO, TraceEnum_ELBO, RenyiELBO],
}
EXPLICIT = (ExplicitMaskCGMM, explicit_with_room)
REFUSALS = (
    (lambda c: c.model in EXPLICIT and c.likelihood != ProfiledGaussian(), "bins are independent given"),
    (lambda c: c.model in EXPLICIT and c.guide in (mean_field, low_rank), "whose masks are summed out"),
    (lambda c: c.guide is refined and isinstance(c.levels, StickBreaking | LogisticNormal), "has no 'pseudo_counts'"),
    (lambda c: c.guide is refined and c.likelihood == FrameActivity(), "has no 'density_generator'"),
    (lambda c: c.model in EXPLICIT and c.estimator is not TraceEnum_ELBO, "discrete mask in every bin"),
    (lambda c: c.model not in EXPLICIT and c.estimator is TraceEnum_ELBO, "has nothing to sum over"),
)


def all_pairs() -> Iterator[Choice]:
    """Every pair of values of two factors, the others being the defaults."""
    seen = set()
    for (first, ones), (second, others) in itertools.combinations(FACTORS.items(), 2):
        for one, other in itertools.product(ones, others):
            choice = Choice(**{first: one, second: other})
            # Explicit masks are summed out by one estimator alone, so it is the default beside them.
            if choice.model in EXPLICIT and "estimator" not in (first, second):
                choice = choice._replace(estimator=TraceEnum_ELBO)
            if choice not in seen:
                seen.add(choice)
                yield choice


def name(choice: Choice) -> str:
    default = Choice()
    changed = [value for value, usual in zip(choice, default, strict=True) if value != usual]
    return "-".join(getattr(value, "__name__", type(value).__name__) for value in changed) or "defaults"


@pytest.fixture
def data() -> tuple[Tensor, Tensor]:
    torch.manual_seed(0)
    return torch.randn(B, 3, 4, T, dtype=torch.complex64), torch.rand(B, 3, 16, 32)


@pytest.fixture(autouse=True)
def empty_store() -> Iterator[None]:
    """A loss in Pyro's default setting keeps its parameters in the global store."""
    yield
    pyro.clear_param_store()


def combine(choice: Choice) -> Combination:
    torch.manual_seed(0)
    model = choice.model(STEERING_FDM, K, choice.levels, choice.directions, likelihood=choice.likelihood)
    return Combination(model, choice.guide(model), choice.estimator())


@pytest.mark.parametrize("choice", list(all_pairs()), ids=name)
def test_every_pair_runs_or_is_refused_with_a_reason(choice: Choice, data: tuple[Tensor, Tensor]) -> None:
    reasons = [sentence for applies, sentence in REFUSALS if applies(choice)]
    if reasons:
        with pytest.raises(InputError, match=reasons[0]):
            combine(choice).elbo(*data)
        return
    combination = combine(choice)
    assert np.isfinite(combination.elbo(*data))
    if isinstance(combination.estimator, RenyiELBO) or getattr(combination.guide, "fits_each_clip", False):
        with pytest.raises(InputError, match=r"gives no loss to differentiate|has nothing to train"):
            combination.trainable_loss()
        return
    loss = combination.trainable_loss()
    loss(*data).backward()
    gradients = [parameter.grad for parameter in loss.parameters() if parameter.grad is not None]
    assert gradients
    assert all(gradient.isfinite().all() for gradient in gradients)


def test_renyis_bound_is_refused_where_bins_count_more_than_once() -> None:
    model = SpatialCGMM(STEERING_FDM, K, bin_weight=3.0)
    with pytest.raises(InputError, match="every bin of this model counts 3 times"):
        Combination(model, amortized(), RenyiELBO())


def test_different_numbers_of_classes_are_refused() -> None:
    with pytest.raises(InputError, match="the guide has 3 source classes and the model 5"):
        Combination(SpatialCGMM(STEERING_FDM, 5), amortized(), Trace_ELBO())


def test_different_numbers_of_diffuse_components_are_refused() -> None:
    with pytest.raises(InputError, match="the guide has 0 diffuse components and the model 2; give both the same"):
        Combination(with_room(STEERING_FDM, K), amortized(), Trace_ELBO())


def test_bounds_are_ordered_and_estimators_agree(data: tuple[Tensor, Tensor]) -> None:
    """Renyi's bound with many particles lies between the ELBO and the log evidence."""
    model, guide = SpatialCGMM(STEERING_FDM, K, SymmetricDirichlet()), amortized()

    def bound(estimator: ELBO) -> float:
        torch.manual_seed(1)
        return Combination(model, guide, estimator).elbo(*data)

    options: Any = {"num_particles": 400, "vectorize_particles": True, "max_plate_nesting": 1}
    trace, mean_field, renyi = (
        bound(Trace_ELBO(**options)),
        bound(TraceMeanField_ELBO(**options)),
        bound(RenyiELBO(alpha=0, **options)),
    )
    assert trace < renyi
    assert mean_field == pytest.approx(trace, abs=2.0)


@pytest.mark.parametrize(
    ("levels", "directions", "analytic"),
    [
        (SparseDirichlet(), LogNormalWeights(), (True, True)),
        (SymmetricDirichlet(), GammaWeights(), (True, False)),
        (StickBreaking(), HalfNormalWeights(), (False, False)),
        (LogisticNormal(), CircularWeights(), (False, False)),
        (SparseDirichlet(), SpikeAndSlabWeights(), (True, False)),
    ],
    ids=str,
)
def test_which_divergences_the_mean_field_estimator_knows(
    levels: Any, directions: Any, analytic: tuple[bool, bool], data: tuple[Tensor, Tensor]
) -> None:
    """It samples the others without saying so."""
    guide, like = amortized(), torch.zeros(())
    parameters = guide.parameters_of(*data)
    weights = guide.direction_posterior(parameters.mu_bkd)
    pi = torch.distributions.Dirichlet(parameters.concentration_bk)
    priors = levels(K, like).expand([B]), directions(K, D, like).expand([B])
    assert (has_analytic_kl(pi, priors[0]), has_analytic_kl(weights, priors[1])) == analytic


def test_the_elbo_is_that_of_trained_parameters_and_leaves_none_behind(data: tuple[Tensor, Tensor]) -> None:
    """Also of a guide that is a function, whose parameters live in Pyro's global store."""
    model = SpatialCGMM(STEERING_FDM, K, SymmetricDirichlet())

    def guide(x_bfmt: Tensor, image_bcij: Tensor) -> None:
        mean = pyro.param("mean", torch.zeros(()))
        with pyro.plate("clip", len(x_bfmt)):
            pyro.sample("direction_weights", pyro.distributions.LogNormal(mean.expand(K, D), 0.1).to_event(2))
            pyro.sample("mixing_levels", pyro.distributions.Dirichlet(torch.ones(K)))

    combination = Combination(model, guide, TraceMeanField_ELBO())
    torch.manual_seed(0)
    untrained = combination.elbo(*data)
    assert not pyro.get_param_store()
    pyro.param("mean", torch.tensor(5.0))
    torch.manual_seed(0)
    # Only the prior minds the scale of the weights: 5^2 / 2 for each of them.
    assert untrained - combination.elbo(*data) == pytest.approx(B * K * D * 12.5, rel=0.1)


def test_empty_classes_keep_their_density_under_a_fitted_guide(data: tuple[Tensor, Tensor]) -> None:
    """Sticks are told from levels where classes are nearly empty only by remembering them."""
    torch.manual_seed(0)
    mu_bkd = torch.zeros(B, K, D)
    concentration_bk = torch.tensor([[40_000.0, 0.01, 0.01]] * B)
    posterior = log_normal_and_dirichlet(mu_bkd, torch.ones_like(mu_bkd), concentration_bk)
    level = posterior.level_posterior(mu_bkd.exp())
    sample = level.rsample()
    exact = log_normal_and_dirichlet(
        mu_bkd.double(), torch.ones_like(mu_bkd).double(), concentration_bk.double()
    ).level_posterior(mu_bkd.double().exp())
    latent = level.transforms[0].inv(sample)
    expected = exact.log_prob(exact.transforms[0](latent.double()))
    torch.testing.assert_close(level.log_prob(sample).double(), expected, rtol=0.01, atol=1.0)


def test_mixed_up_arguments_are_told(data: tuple[Tensor, Tensor]) -> None:
    model, guide = SpatialCGMM(STEERING_FDM, K), amortized()
    with pytest.raises(InputError, match="AmortizedGuide is no SpatialCGMM; the order is model, guide, estimator"):
        Combination(guide, model, Trace_ELBO())
    with pytest.raises(InputError, match=r"is no estimator; give an object such as Trace_ELBO\(\)"):
        Combination(model, guide, Trace_ELBO)
    with pytest.raises(InputError, match="has nothing to train"):
        Combination(model, mean_field(model).fitted_to(*data), Trace_ELBO()).trainable_loss()
    with pytest.raises(InputError, match="the start has 3 source classes and the model 4"):
        PerClipGuide(guide, SpatialCGMM(STEERING_FDM, K + 1))
