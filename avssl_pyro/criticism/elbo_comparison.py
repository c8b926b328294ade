"""Comparison of Pyro's ELBO with closed forms and explicit masks, by terms and gradients."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import pyro.settings
import torch
from pyro.infer import TraceEnum_ELBO
from torch import Tensor

from avssl_pyro.criticism.closed_form import ClosedFormTerms, closed_form_terms, onset_weights
from avssl_pyro.guides.amortized import AmortizedGuide
from avssl_pyro.models.explicit_masks import ExplicitMaskCGMM
from avssl_pyro.models.likelihoods import PrecedenceGaussian
from avssl_pyro.models.spatial_cgmm import SpatialCGMM
from avssl_pyro.systems.system import System
from avssl_pyro.training.elbo_terms import TraceELBOWithTerms, TraceMeanFieldELBOWithTerms


@dataclass(frozen=True)
class Difference:
    """One quantity computed in two ways.

    Args:
        name: name of the quantity.
        reference: reference value.
        value: value by Pyro.
        relative: relative difference ``|value - reference| / |reference|``; for gradients the largest difference over
            all parameters relative to the largest gradient.
    """

    name: str
    reference: float
    value: float
    relative: float


@dataclass(frozen=True)
class SampledAgreement:
    """Single-sample Trace_ELBO losses against closed-form losses at the same noise, which differ by their KL terms.

    Args:
        mean: mean of the Trace_ELBO losses.
        reference: mean of the closed-form losses.
        standard_error: standard error of the mean difference.
    """

    mean: float
    reference: float
    standard_error: float

    @property
    def z_score(self) -> float:
        return (self.mean - self.reference) / self.standard_error


def mean_field_differences(system: System, x_bfmt: Tensor, image_bcij: Tensor, seed: int = 0) -> list[Difference]:
    """TraceMeanField_ELBO against Eqs. (15)-(19) at one seed: every term, the loss, every gradient of the guide."""
    estimator = TraceMeanFieldELBOWithTerms()
    loss_module = estimator(system.model, system.guide)
    loss, gradient = _evaluate(system, seed, lambda: loss_module(x_bfmt, image_bcij))
    assert estimator.terms is not None
    reference: list[ClosedFormTerms] = []

    def closed_form() -> Tensor:
        reference.append(_closed_form(system, x_bfmt, image_bcij))
        return reference[0].loss

    reference_loss, reference_gradient = _evaluate(system, seed, closed_form)
    pairs = {
        "log likelihood": (reference[0].log_likelihood_b, estimator.terms.log_likelihood_b),
        "KL of w": (reference[0].kl_weights_b, estimator.terms.kl_b["direction_weights"]),
        "KL of pi": (reference[0].kl_levels_b, estimator.terms.kl_b["mixing_levels"]),
    }
    if reference[0].kl_diffuse_b is not None:
        pairs["KL of e"] = (reference[0].kl_diffuse_b, estimator.terms.kl_b["diffuse_weights"])
    pairs["loss"] = (reference_loss, loss)
    differences = [_difference(name, expected.sum(), found.sum()) for name, (expected, found) in pairs.items()]
    return [*differences, _gradient_difference(reference_gradient, gradient)]


def explicit_mask_differences(system: System, x_bfmt: Tensor, image_bcij: Tensor, seed: int = 0) -> list[Difference]:
    """The marginalised model under Trace_ELBO against masks enumerated by TraceEnum_ELBO at one seed.

    Both count every bin alike; a model that weighs bins is compared with its weights at 1.
    """
    own = system.model
    with pyro.settings.context(module_local_params=True):
        explicit, marginal = (
            kind(
                system.config.steering(torch.complex128),
                own.num_sources,
                own.level_prior,
                own.direction_prior,
                own.diffuse,
                own.bin_weight,
                room=own.room,
            )
            for kind in (ExplicitMaskCGMM, SpatialCGMM)
        )
    by_masks = TraceEnum_ELBO(max_plate_nesting=3)(explicit, system.guide)
    summed_out = TraceELBOWithTerms()(marginal, system.guide)
    reference_loss, reference_gradient = _evaluate(system, seed, lambda: by_masks(x_bfmt, image_bcij))
    loss, gradient = _evaluate(system, seed, lambda: summed_out(x_bfmt, image_bcij))
    return [_difference("loss", reference_loss, loss), _gradient_difference(reference_gradient, gradient)]


def sampled_agreement(
    system: System, x_bfmt: Tensor, image_bcij: Tensor, draws: int = 50, seed: int = 0
) -> SampledAgreement:
    """Trace_ELBO, which samples its KL terms, against the closed form at the same noise, over many draws."""
    estimator = TraceELBOWithTerms()(system.model, system.guide)
    losses = torch.empty(2, draws, dtype=torch.float64)
    with torch.no_grad(), pyro.settings.context(module_local_params=True):
        for draw in range(draws):
            torch.manual_seed(seed + draw)
            losses[0, draw] = estimator(x_bfmt, image_bcij)
            torch.manual_seed(seed + draw)
            losses[1, draw] = _closed_form(system, x_bfmt, image_bcij).loss
    mean, reference = losses.mean(-1).tolist()
    return SampledAgreement(mean, reference, (losses[0] - losses[1]).std().item() / math.sqrt(draws))


def _closed_form(system: System, x_bfmt: Tensor, image_bcij: Tensor) -> ClosedFormTerms:
    assert isinstance(system.guide, AmortizedGuide)
    sizes, likelihood = system.config.model, system.config.likelihood()
    bin_weight_bft = None
    if isinstance(likelihood, PrecedenceGaussian):
        log_decay = -math.log(1e6) * likelihood.frame_s / likelihood.decay_s
        bin_weight_bft = onset_weights(x_bfmt, log_decay, likelihood.least)
    terms = closed_form_terms(
        system.guide,
        system.config.steering(torch.complex128),
        x_bfmt,
        image_bcij,
        prior_alpha=sizes.alpha,
        prior_sigma=sizes.sigma,
        diffuse=sizes.diffuse,
        room=system.config.room(),
        bin_weight_bft=bin_weight_bft,
    )
    return replace(terms, log_likelihood_b=sizes.bin_weight * terms.log_likelihood_b)


def _evaluate(system: System, seed: int, loss: Callable[[], Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
    system.guide.zero_grad()
    torch.manual_seed(seed)
    # Else Pyro's global store would keep these parameters, and a later SVI on another guide would train them instead.
    with pyro.settings.context(module_local_params=True):
        value = loss()
    value.backward()
    gradient = {
        name: parameter.grad.clone()
        for name, parameter in system.guide.named_parameters()
        if parameter.grad is not None
    }
    system.guide.zero_grad()
    return value.detach(), gradient


def _difference(name: str, reference: Tensor, value: Tensor) -> Difference:
    relative = abs(value.item() - reference.item()) / max(abs(reference.item()), 1e-300)
    return Difference(name, reference.item(), value.item(), relative)


def _gradient_difference(reference: dict[str, Tensor], value: dict[str, Tensor]) -> Difference:
    assert reference.keys() == value.keys()
    norm = {
        which: math.sqrt(sum(grad.square().sum().item() for grad in gradients.values()))
        for which, gradients in (("reference", reference), ("value", value))
    }
    # Some gradients vanish by symmetry (a shift of all logits); relative to themselves they would be all rounding.
    largest = max(grad.abs().max().item() for grad in reference.values())
    worst = max((value[name] - reference[name]).abs().max().item() for name in reference)
    return Difference("gradients (norm)", norm["reference"], norm["value"], worst / largest)
