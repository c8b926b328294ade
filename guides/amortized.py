"""The amortised guide: two networks map a picture and a recording to the posterior of one clip (Sec. III-D)."""

import math
from typing import NamedTuple

import pyro
import pyro.distributions as dist
import torch
from pyro.nn import PyroModule
from torch import Tensor, nn

from avssl_pyro.networks.audio import AudioNet
from avssl_pyro.networks.visual import VisualNet

# exp(+-20) spans more than any array resolves, and keeps products of weights inside float32.
LOG_WEIGHT_LIMIT = 20.0
# Dirichlet concentrations below this make float32 samples and digamma gradients overflow.
LEAST_CONCENTRATION = 1e-3


class GuideParameters(NamedTuple):
    """Variational parameters of a batch of clips, at the mean of w as used for localization.

    Args:
        mu_bkd: means of log w, (B, K, D).
        sigma_k: standard deviations of log w, (K,).
        concentration_bk: Dirichlet concentrations beta * pi_bar, (B, K).
        activation_bkij: 2-D activation maps of the visual network, (B, K, I', J').
    """

    mu_bkd: Tensor
    sigma_k: Tensor
    concentration_bk: Tensor
    activation_bkij: Tensor


class AmortizedGuide(PyroModule):
    """q(w | image) = LogNormal(mu, sigma_k^2) and q(pi | x, w) = Dir(beta * pi_bar), with sigma_k and beta learned.

    Args:
        visual: maps an image to log-weights mu_bkd.
        audio: maps a spectrogram and normalised weights to levels pi_bar_bk.
        initial_sigma: sigma_k before training.
        initial_beta: beta before training.
    """

    def __init__(
        self, visual: VisualNet, audio: AudioNet, initial_sigma: float = 0.3, initial_beta: float = 100.0
    ) -> None:
        super().__init__()
        self.visual = visual
        self.audio = audio
        self.log_sigma_k = nn.Parameter(torch.full((visual.num_sources,), math.log(initial_sigma)))
        self.log_beta = nn.Parameter(torch.tensor(math.log(initial_beta)))

    def direction_posterior(self, mu_bkd: Tensor) -> dist.TorchDistribution:
        """q(w | image), batch_shape (B,), event_shape (K, D)."""
        return dist.LogNormal(mu_bkd, self.log_sigma_k.exp()[:, None]).to_event(2)

    def concentration(self, feature_bcdt: Tensor, w_bkd: Tensor) -> Tensor:
        """Concentrations of q(pi | x, w), (B..., K)."""
        level_bk = self.audio.levels(feature_bcdt, w_bkd / w_bkd.sum(-1, keepdim=True))
        return (self.log_beta.exp() * level_bk).clamp_min(LEAST_CONCENTRATION)

    def log_weights(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        """mu_bkd and the 2-D activation maps it was pooled from."""
        mu_bkd, activation_bkij = self.visual(image_bcij)
        mu_bkd = mu_bkd.to(self.log_sigma_k.dtype)
        return mu_bkd.clamp(-LOG_WEIGHT_LIMIT, LOG_WEIGHT_LIMIT), activation_bkij

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        mu_bkd, _ = self.log_weights(image_bcij)
        feature_bcdt = self.audio.direction_features(x_bfmt)
        with pyro.plate("clip", x_bfmt.shape[0], dim=-1):
            w_bkd = pyro.sample("direction_weights", self.direction_posterior(mu_bkd))
            pyro.sample("mixing_levels", dist.Dirichlet(self.concentration(feature_bcdt, w_bkd)))

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """The posterior's parameters with w at softmax(mu), Eq. (1), as used for localization."""
        mu_bkd, activation_bkij = self.log_weights(image_bcij)
        concentration_bk = self.concentration(self.audio.direction_features(x_bfmt), mu_bkd.softmax(-1))
        return GuideParameters(mu_bkd, self.log_sigma_k.exp(), concentration_bk, activation_bkij)
