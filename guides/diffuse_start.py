"""Starts for models with a room from guides of any kind, with or without parameters of the diffuse weights."""

import math
from typing import Any

import pyro
import torch
from pyro import poutine
from torch import Tensor

from avssl_pyro.distributions.seeded import seeded
from avssl_pyro.errors import InputError
from avssl_pyro.guides.base import GuideParameters
from avssl_pyro.guides.gaussian_families import ClipModel
from avssl_pyro.guides.refinement_config import RefinementConfig

DIFFUSE_START = RefinementConfig().diffuse_start


def with_diffuse_start(log_w_bkd: Tensor, components: int, share: float = DIFFUSE_START) -> Tensor:
    """Log-weights with as many equal diffuse ones after them, together the given share of the sum, (B, K, D + C)."""
    if components == 0:
        return log_w_bkd
    ratio = share / (1 - share) / components
    log_e_bk1 = log_w_bkd.logsumexp(-1, keepdim=True) + math.log(ratio)
    return torch.cat([log_w_bkd, log_e_bk1.expand(*log_e_bk1.shape[:-1], components)], dim=-1)


def start_for(model: ClipModel, parameters: GuideParameters, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
    """Parameters of exactly the latent sites of a model.

    Diffuse weights that the parameters lack start at the share of a refinement, with the mean spread of their class.

    Args:
        model: model with or without the site ``diffuse_weights``.
        parameters: variational parameters of the clips.
        x_bfmt, image_bcij: spectrograms and images of the clips.

    Raises:
        InputError: the parameters are of another number of diffuse components than the model.
    """
    components = num_components_of(model, x_bfmt, image_bcij)
    if components == 0:
        return parameters._replace(diffuse_mu_bkc=None, diffuse_sigma_bkc=None)
    mu_bkc = parameters.diffuse_mu_bkc
    if mu_bkc is None:
        num_directions = parameters.mu_bkd.shape[-1]
        mu_bkj = with_diffuse_start(parameters.mu_bkd, components)
        mu_bkc = mu_bkj[..., num_directions:]
        sigma_bkc = parameters.sigma_bkd.mean(-1, keepdim=True).expand_as(mu_bkc)
        return parameters._replace(diffuse_mu_bkc=mu_bkc, diffuse_sigma_bkc=sigma_bkc)
    found = mu_bkc.shape[-1]
    if found != components:
        raise InputError(
            f"the start has {found} diffuse components and the room of the model {components}; give both the same."
        )
    return parameters


def num_components_of(model: ClipModel, x_bfmt: Tensor, image_bcij: Tensor) -> int:
    """Number of diffuse components C of a model; 0 without the site ``diffuse_weights``."""
    with (
        torch.no_grad(),
        poutine.block(),
        pyro.get_param_store().scope(),
        pyro.validation_enabled(False),
        seeded(0, x_bfmt.device),
        poutine.trace() as tracer,
    ):
        model(x_bfmt[:1], image_bcij[:1])
    nodes: Any = tracer.trace.nodes
    return int(nodes["diffuse_weights"]["value"].shape[-1]) if "diffuse_weights" in nodes else 0
