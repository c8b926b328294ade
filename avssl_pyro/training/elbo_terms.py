"""Pyro's ELBO estimators with a record of their terms: likelihood, KL of w, KL of pi.

The terms come from the traces that the estimator makes anyway, so the record costs next to nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from pyro.infer import Trace_ELBO, TraceMeanField_ELBO
from pyro.poutine import Trace
from torch import Tensor
from torch.distributions import kl_divergence


@dataclass(frozen=True)
class ElboTerms:
    """One evaluation of the ELBO, term by term and clip by clip; detached.

    Args:
        log_likelihood_b: log p(x | w, pi) at the sampled latents, (B,).
        kl_b: for every latent site KL(q || p), (B,); analytic where torch has it, else log q - log p at the sample.
    """

    log_likelihood_b: Tensor
    kl_b: Mapping[str, Tensor]

    @property
    def elbo_b(self) -> Tensor:
        """The evidence lower bound of every clip, (B,)."""
        return self.log_likelihood_b - sum(self.kl_b.values(), torch.zeros_like(self.log_likelihood_b))

    def named(self) -> dict[str, Tensor]:
        """Every term by its name, (B,) each."""
        return {"log_likelihood": self.log_likelihood_b, **{f"kl_{site}": kl_b for site, kl_b in self.kl_b.items()}}

    @classmethod
    @torch.no_grad()
    def from_traces(cls, model_trace: Trace, guide_trace: Trace) -> "ElboTerms":
        likelihood, kl = [], {}
        for name in model_trace.stochastic_nodes + model_trace.observation_nodes:
            prior = model_trace.nodes[name]
            if prior["is_observed"]:
                likelihood.append(_mean_over_particles(prior["log_prob"]))
            elif name in guide_trace.nodes:
                posterior = guide_trace.nodes[name]
                kl[name] = _mean_over_particles(_kl(prior, posterior))
        return cls(torch.stack(likelihood).sum(0), kl)


def _kl(prior: Mapping[str, Any], posterior: Mapping[str, Any]) -> Tensor:
    if has_analytic_kl(posterior["fn"], prior["fn"]):
        return kl_divergence(posterior["fn"], prior["fn"])
    difference: Tensor = posterior["log_prob"] - prior["log_prob"]
    return difference


def has_analytic_kl(posterior: Any, prior: Any) -> bool:
    """Whether torch has KL(posterior || prior) in closed form; TraceMeanField_ELBO samples it silently if not."""
    try:
        with torch.no_grad():
            kl_divergence(posterior, prior)
    except NotImplementedError:
        return False
    return True


def _mean_over_particles(value: Tensor) -> Tensor:
    return value if value.dim() <= 1 else value.flatten(0, -2).mean(0)


class ElboTermsMixin:
    """Mixin of an ELBO estimator that keeps the terms and the guide's trace of its last evaluation."""

    terms: ElboTerms | None = None
    guide_trace: Trace | None = None

    def _get_trace(self, model: Any, guide: Any, args: Any, kwargs: Any) -> tuple[Trace, Trace]:
        model_trace, guide_trace = super()._get_trace(model, guide, args, kwargs)  # type: ignore[misc]
        self.terms = ElboTerms.from_traces(model_trace, guide_trace)
        self.guide_trace = guide_trace
        return model_trace, guide_trace


class TraceELBOWithTerms(ElboTermsMixin, Trace_ELBO):
    """Trace_ELBO that records its terms."""


class TraceMeanFieldELBOWithTerms(ElboTermsMixin, TraceMeanField_ELBO):
    """TraceMeanField_ELBO (analytic KL where torch has one) that records its terms."""
