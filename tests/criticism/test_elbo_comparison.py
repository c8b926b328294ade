"""The cross-check: Pyro's estimators against the closed forms and against explicit masks.

::

      w ~ q(w | image) --> pi ~ q(pi | x, w)         one draw, shared by every way of computing the ELBO
             |                   |
             |    TraceMeanField_ELBO  = Eqs. (15) + (18) + (19) by hand     to rounding, with all gradients
             |    Trace_ELBO           = TraceEnum_ELBO over masks           to rounding, with all gradients
             |    Trace_ELBO           ~ the closed form                     within standard errors
"""

from collections.abc import Iterator
from dataclasses import replace

import pyro
import pyro.distributions as dist
import pytest
import torch
from attrs import evolve
from pyro.infer import TraceMeanField_ELBO
from torch import Tensor
from torch.distributions import kl_divergence

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.stft import stft
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.criticism import closed_form
from avssl_pyro.criticism.elbo_comparison import (
    Difference,
    explicit_mask_differences,
    mean_field_differences,
    sampled_agreement,
)
from avssl_pyro.distributions.precedence import log_decay_of, precedence_weights
from avssl_pyro.distributions.profiled_gaussian import observe
from avssl_pyro.distributions.spatial_mixture import SpatialMixture
from avssl_pyro.models.likelihoods import PrecedenceGaussian
from avssl_pyro.models.priors import LogNormalWeights, SparseDirichlet
from avssl_pyro.models.room import ROOM_DIFFUSE
from avssl_pyro.models.spatial_cgmm import SpatialCGMM
from avssl_pyro.systems.config import GuideConfig, ModelConfig
from avssl_pyro.systems.system import System, SystemConfig, build_system
from avssl_pyro.training.elbo_terms import TraceELBOWithTerms, TraceMeanFieldELBOWithTerms, has_analytic_kl

CONFIG = SystemConfig(
    PRESETS["circle4"],
    model=ModelConfig(num_sources=3),
    guide=GuideConfig(visual_channels=(4, 6), audio_channels=4),
    stft=StftConfig(window=64, hop=160),
)
ROOM_MODEL = ModelConfig(num_sources=3, num_directions=36, diffuse=ROOM_DIFFUSE, room=True)
EXACT = 1e-9


@pytest.fixture(autouse=True)
def _fresh_parameter_store() -> Iterator[None]:
    yield
    pyro.clear_param_store()


def make_system(config: SystemConfig = CONFIG) -> System:
    torch.manual_seed(3)
    system = build_system(config, torch.float64)
    system.model.eval()
    system.guide.eval()
    return system


@pytest.fixture
def system() -> System:
    return make_system()


@pytest.fixture
def clips() -> tuple[Tensor, Tensor]:
    torch.manual_seed(4)
    audio_bmn = torch.randn(2, 4, 1600, dtype=torch.float64)
    audio_bmn[0, :, 400:800] = 0
    return stft(audio_bmn, CONFIG.stft), torch.rand(2, 3, 88, 288, dtype=torch.float64)


def by_name(differences: list[Difference]) -> dict[str, float]:
    return {difference.name: difference.relative for difference in differences}


@pytest.mark.parametrize(
    "sizes",
    [ModelConfig(num_sources=3), ModelConfig(num_sources=1), ModelConfig(3, 36, alpha=0.5, sigma=2.0, diffuse=0.01)],
    ids=["default", "one class", "other priors"],
)
def test_mean_field_elbo_is_the_closed_form(sizes: ModelConfig, clips: tuple[Tensor, Tensor]) -> None:
    relative = by_name(mean_field_differences(make_system(replace(CONFIG, model=sizes)), *clips, seed=5))
    assert set(relative) == {"log likelihood", "KL of w", "KL of pi", "loss", "gradients (norm)"}
    # One class alone is certain: its levels have no divergence but rounding.
    if sizes.num_sources == 1:
        del relative["KL of pi"]
    assert max(relative.values()) <= EXACT, relative


def test_mean_field_elbo_of_a_room_is_the_closed_form(clips: tuple[Tensor, Tensor]) -> None:
    system = make_system(replace(CONFIG, model=ROOM_MODEL))
    assert isinstance(system.model.likelihood, PrecedenceGaussian)
    relative = by_name(mean_field_differences(system, *clips, seed=5))
    assert set(relative) == {"log likelihood", "KL of w", "KL of pi", "KL of e", "loss", "gradients (norm)"}
    assert max(relative.values()) <= EXACT, relative
    assert all(sites(system, clips).values())


def test_other_comparisons_of_a_room(clips: tuple[Tensor, Tensor]) -> None:
    system = make_system(replace(CONFIG, model=ROOM_MODEL))
    relative = by_name(explicit_mask_differences(system, *clips, seed=6))
    assert max(relative.values()) <= EXACT, relative
    agreement = sampled_agreement(system, *clips, draws=60)
    assert abs(agreement.z_score) <= 4


def test_weights_of_bins_by_recursion_are_those_of_the_distribution(clips: tuple[Tensor, Tensor]) -> None:
    x_bfmt, _ = clips
    log_decay, least = log_decay_of(0.5, 0.01), 0.05
    found_bft = closed_form.onset_weights(x_bfmt, log_decay, least)
    torch.testing.assert_close(found_bft, precedence_weights(observe(x_bfmt), log_decay, least), rtol=1e-10, atol=0)
    assert found_bft.std() > 0.1


@pytest.mark.parametrize(
    ("name", "term"), [("room_log_likelihood", "log likelihood"), ("kl_diffuse_weights", "KL of e")]
)
def test_a_wrong_term_of_a_room_is_caught_and_named(
    name: str, term: str, clips: tuple[Tensor, Tensor], monkeypatch: pytest.MonkeyPatch
) -> None:
    right = getattr(closed_form, name)
    monkeypatch.setattr(closed_form, name, lambda *args: 1.01 * right(*args))
    relative = by_name(mean_field_differences(make_system(replace(CONFIG, model=ROOM_MODEL)), *clips))
    touched = {term, "loss", "gradients (norm)"}
    assert {other for other, value in relative.items() if value > EXACT} == touched


def test_marginal_elbo_is_that_of_explicit_masks(system: System, clips: tuple[Tensor, Tensor]) -> None:
    relative = by_name(explicit_mask_differences(system, *clips, seed=6))
    assert set(relative) == {"loss", "gradients (norm)"}
    assert max(relative.values()) <= EXACT, relative


def test_sampled_elbo_agrees_within_its_standard_error(system: System, clips: tuple[Tensor, Tensor]) -> None:
    agreement = sampled_agreement(system, *clips, draws=60)
    assert abs(agreement.z_score) <= 4
    assert agreement.standard_error > 0
    assert agreement.standard_error < 0.01 * abs(agreement.reference)


def test_comparison_leaves_nothing_behind(system: System, clips: tuple[Tensor, Tensor]) -> None:
    before = {name: value.clone() for name, value in system.state_dict().items()}
    mean_field_differences(system, *clips)
    explicit_mask_differences(system, *clips)
    sampled_agreement(system, *clips, draws=2)
    assert all(torch.equal(value, before[name]) for name, value in system.state_dict().items())
    assert all(parameter.grad is None for parameter in system.guide.parameters())
    # What stays in Pyro's global store is what a later SVI, on whatever guide, would train.
    assert not pyro.get_param_store()


@pytest.mark.parametrize(
    ("name", "term"),
    [
        ("log_likelihood", "log likelihood"),
        ("kl_log_normal", "KL of w"),
        ("kl_dirichlet", "KL of pi"),
    ],
)
def test_a_wrong_term_is_caught_and_named(
    name: str,
    term: str,
    system: System,
    clips: tuple[Tensor, Tensor],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    right = getattr(closed_form, name)
    monkeypatch.setattr(closed_form, name, lambda *args: 1.01 * right(*args))
    relative = by_name(mean_field_differences(system, *clips))
    assert relative[term] > 5e-3
    touched = {term, "loss", "gradients (norm)"}
    assert {other for other, value in relative.items() if value > EXACT} == touched


@pytest.mark.parametrize(
    ("wrong", "term"),
    [(evolve(CONFIG.model, alpha=0.02), "KL of pi"), (evolve(CONFIG.model, sigma=1.1), "KL of w")],
)
def test_a_prior_that_is_not_the_configured_one_is_caught(
    wrong: ModelConfig, term: str, system: System, clips: tuple[Tensor, Tensor]
) -> None:
    other = replace(system, config=replace(CONFIG, model=wrong))
    relative = by_name(mean_field_differences(other, *clips))
    assert relative[term] > 1e-3


def test_a_wrong_likelihood_is_caught_by_both(
    system: System, clips: tuple[Tensor, Tensor], monkeypatch: pytest.MonkeyPatch
) -> None:
    right = SpatialMixture.scm_bkfmm.fget
    assert right is not None
    wrong = property(lambda mixture: right(mixture) + 0.01 * torch.eye(4))
    monkeypatch.setattr(SpatialMixture, "scm_bkfmm", wrong)
    relative = by_name(mean_field_differences(system, *clips))
    assert relative["log likelihood"] > 1e-5
    assert relative["KL of w"] <= EXACT
    explicit = by_name(explicit_mask_differences(system, *clips))
    assert min(explicit.values()) > 1e-5


# ---------------------------------------------------------------------------------------------------------------------
# Which divergences are analytic: TraceMeanField_ELBO samples the others without a word.


def sites(system: System, clips: tuple[Tensor, Tensor]) -> dict[str, bool]:
    """Whether each latent site's divergence is analytic."""
    guide = pyro.poutine.trace(system.guide).get_trace(*clips)
    model = pyro.poutine.trace(pyro.poutine.replay(system.model, guide)).get_trace(*clips)
    return {
        name: has_analytic_kl(guide.nodes[name]["fn"], model.nodes[name]["fn"])
        for name in guide.stochastic_nodes
        if name != "clip"
    }


def test_every_divergence_of_the_default_system_is_analytic(system: System, clips: tuple[Tensor, Tensor]) -> None:
    assert sites(system, clips) == {"direction_weights": True, "mixing_levels": True}


def test_certain_levels_cost_their_prior_density(clips: tuple[Tensor, Tensor]) -> None:
    without_audio = make_system(replace(CONFIG, guide=evolve(CONFIG.guide, audio_net=False)))
    assert sites(without_audio, clips) == {"direction_weights": True, "mixing_levels": True}
    estimator = TraceMeanFieldELBOWithTerms()
    estimator(without_audio.model, without_audio.guide)(*clips)
    assert estimator.terms is not None
    prior = dist.Dirichlet(torch.full((3,), 0.01, dtype=torch.float64))
    expected = -prior.log_prob(torch.full((3,), 1 / 3, dtype=torch.float64)).item()
    assert estimator.terms.kl_b["mixing_levels"].tolist() == pytest.approx([expected] * 2)


@pytest.mark.parametrize(
    ("posterior", "prior", "analytic"),
    [
        (dist.LogNormal(torch.zeros(2, 3), 1.0).to_event(2), dist.LogNormal(torch.ones(2, 3), 2.0).to_event(2), True),
        (dist.Dirichlet(torch.ones(3)), dist.Dirichlet(torch.ones(3)).expand([4]), True),
        (dist.Gamma(torch.ones(3), 1.0).to_event(1), dist.Gamma(torch.ones(3), 2.0).to_event(1), True),
        (dist.Gamma(torch.ones(3), 1.0).to_event(1), dist.LogNormal(torch.zeros(3), 1.0).to_event(1), False),
        (dist.LogNormal(torch.zeros(3), 1.0).to_event(1), dist.Gamma(torch.ones(3), 1.0).to_event(1), False),
        (dist.VonMises(torch.zeros(3), 1.0).to_event(1), dist.VonMises(torch.zeros(3), 1.0).to_event(1), False),
    ],
)
def test_known_pairs(posterior: dist.TorchDistribution, prior: dist.TorchDistribution, analytic: bool) -> None:
    assert has_analytic_kl(posterior, prior) is analytic


def gamma_weights(num_sources: int, num_directions: int, like: Tensor) -> dist.TorchDistribution:
    return dist.Gamma(like.new_full((num_sources, num_directions), 2.0), like.new_ones(())).to_event(2)


def test_terms_without_analytic_divergence_are_those_pyro_samples(system: System, clips: tuple[Tensor, Tensor]) -> None:
    model = SpatialCGMM(CONFIG.steering(torch.complex128), 3, direction_prior=gamma_weights)
    assert sites(replace(system, model=model), clips) == {"direction_weights": False, "mixing_levels": True}
    estimator = TraceMeanFieldELBOWithTerms()
    torch.manual_seed(7)
    loss = estimator(model, system.guide)(*clips)
    assert estimator.terms is not None
    torch.testing.assert_close(-estimator.terms.elbo_b.sum(), loss.detach(), rtol=1e-12, atol=0)
    torch.manual_seed(7)
    guide = pyro.poutine.trace(system.guide).get_trace(*clips)
    w_bkd = guide.nodes["direction_weights"]["value"]
    expected_b = guide.nodes["direction_weights"]["fn"].log_prob(w_bkd) - gamma_weights(3, 72, w_bkd).log_prob(w_bkd)
    torch.testing.assert_close(estimator.terms.kl_b["direction_weights"], expected_b.detach())


# ---------------------------------------------------------------------------------------------------------------------
# The recorded terms.


@pytest.mark.parametrize("particles", [1, 3])
@pytest.mark.parametrize("vectorize", [False, True])
def test_recorded_terms_add_up_to_the_loss(
    particles: int, vectorize: bool, system: System, clips: tuple[Tensor, Tensor]
) -> None:
    estimator = TraceMeanFieldELBOWithTerms(num_particles=particles, vectorize_particles=vectorize, max_plate_nesting=1)
    plain = TraceMeanField_ELBO(num_particles=particles, vectorize_particles=vectorize, max_plate_nesting=1)
    torch.manual_seed(8)
    loss = estimator(system.model, system.guide)(*clips).item()
    torch.manual_seed(8)
    assert plain(system.model, system.guide)(*clips).item() == loss
    assert estimator.terms is not None
    named = estimator.terms.named()
    assert set(named) == {"log_likelihood", "kl_direction_weights", "kl_mixing_levels"}
    assert all(value_b.shape == (2,) and not value_b.requires_grad for value_b in named.values())
    if particles == 1 or vectorize:
        assert -estimator.terms.elbo_b.sum().item() == pytest.approx(loss, rel=1e-12)


def test_trace_elbo_records_analytic_terms_beside_its_sampled_loss(
    system: System, clips: tuple[Tensor, Tensor]
) -> None:
    sampled, analytic = TraceELBOWithTerms(), TraceMeanFieldELBOWithTerms()
    for estimator in (sampled, analytic):
        torch.manual_seed(9)
        estimator(system.model, system.guide)(*clips)
    assert sampled.terms is not None
    assert analytic.terms is not None
    for name, value_b in analytic.terms.named().items():
        torch.testing.assert_close(sampled.terms.named()[name], value_b)


@pytest.mark.parametrize("alpha", [0.01, 0.5, 3.0])
def test_dirichlet_divergence_by_hand(alpha: float) -> None:
    concentration_bk = torch.rand(4, 5, dtype=torch.float64) * 10 + 0.01
    expected = kl_divergence(dist.Dirichlet(concentration_bk), SparseDirichlet(alpha)(5, concentration_bk).expand([4]))
    torch.testing.assert_close(closed_form.kl_dirichlet(concentration_bk, alpha), expected)


@pytest.mark.parametrize("prior_sigma", [0.5, 1.0, 3.0])
def test_log_normal_divergence_by_hand(prior_sigma: float) -> None:
    mu_bkd, sigma_k = torch.randn(4, 2, 3, dtype=torch.float64), torch.tensor([0.3, 2.0], dtype=torch.float64)
    posterior = dist.LogNormal(mu_bkd, sigma_k[:, None]).to_event(2)
    expected = kl_divergence(posterior, LogNormalWeights(prior_sigma)(2, 3, mu_bkd).expand([4]))
    torch.testing.assert_close(closed_form.kl_log_normal(mu_bkd, sigma_k, prior_sigma), expected)
