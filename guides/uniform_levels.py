"""The guide without an audio network, "w/o Aud" of the paper's Sec. IV: every source class is equally loud."""

import math

import pyro
import pyro.distributions as dist
import torch
from pyro.nn import PyroModule
from torch import Tensor, nn

from avssl_pyro.guides.amortized import LOG_WEIGHT_LIMIT, GuideParameters
from avssl_pyro.networks.visual import VisualNet


class UniformLevelGuide(PyroModule):
    """q(w | image) as in :class:`AmortizedGuide`; pi is fixed to 1/K.

    Args:
        visual: maps an image to log-weights mu_bkd.
        initial_sigma: sigma_k before training.
    """

    def __init__(self, visual: VisualNet, initial_sigma: float = 0.3) -> None:
        super().__init__()
        self.visual = visual
        self.log_sigma_k = nn.Parameter(torch.full((visual.num_sources,), math.log(initial_sigma)))

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        mu_bkd, _ = self.log_weights(image_bcij)
        with pyro.plate("clip", x_bfmt.shape[0], dim=-1):
            pyro.sample("direction_weights", dist.LogNormal(mu_bkd, self.log_sigma_k.exp()[:, None]).to_event(2))
            levels_k = mu_bkd.new_full((mu_bkd.shape[-2],), 1 / mu_bkd.shape[-2])
            pyro.sample("mixing_levels", dist.Delta(levels_k, event_dim=1))

    def log_weights(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        mu_bkd, activation_bkij = self.visual(image_bcij)
        mu_bkd = mu_bkd.to(self.log_sigma_k.dtype)
        return mu_bkd.clamp(-LOG_WEIGHT_LIMIT, LOG_WEIGHT_LIMIT), activation_bkij

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:  # noqa: ARG002
        """The posterior's parameters; the concentrations are equal and so large that the levels are certain."""
        mu_bkd, activation_bkij = self.log_weights(image_bcij)
        concentration_bk = mu_bkd.new_full(mu_bkd.shape[:-1], 1 / torch.finfo(mu_bkd.dtype).eps)
        return GuideParameters(mu_bkd, self.log_sigma_k.exp(), concentration_bk, activation_bkij)
