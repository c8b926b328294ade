"""The amortised guide: two networks map a picture and a recording to the posterior of one clip (Sec. III-D)."""

import math

import pyro
import pyro.distributions as dist
import torch
from torch import Tensor, nn

from avssl_pyro.guides.base import DirectionGuide, GuideParameters
from avssl_pyro.networks.audio import AudioNet
from avssl_pyro.networks.visual import VisualNet

# Dirichlet concentrations below this make float32 samples and digamma gradients overflow.
LEAST_CONCENTRATION = 1e-3


class AmortizedGuide(DirectionGuide):
    """q(w | image) = LogNormal(mu, sigma_k^2) and q(pi | x, w) = Dir(beta * pi_bar), with sigma_k and beta learned.

    Args:
        visual: maps an image to log-weights mu_bkd.
        audio: maps a spectrogram and normalised weights to levels pi_bar_bk.
        initial_sigma, diffuse_class: as of :class:`DirectionGuide`.
        initial_beta: beta before training.

    >>> from avssl_pyro.acoustics.grid import DirectionGrid
    >>> from avssl_pyro.acoustics.presets import PRESETS
    >>> from avssl_pyro.acoustics.stft_config import StftConfig
    >>> steering_fdm = PRESETS["circle4"].steering_vectors(DirectionGrid(72), StftConfig().frequencies)
    >>> guide = AmortizedGuide(VisualNet(num_sources=4), AudioNet(steering_fdm.to(torch.complex64)))
    >>> x_bfmt = torch.ones(1, 257, 4, 10, dtype=torch.complex64)
    >>> guide.parameters_of(x_bfmt, torch.zeros(1, 3, 88, 288)).mu_bkd.shape
    torch.Size([1, 4, 72])
    """

    def __init__(
        self,
        visual: VisualNet,
        audio: AudioNet,
        initial_sigma: float = 0.3,
        initial_beta: float = 100.0,
        diffuse_class: bool = False,
    ) -> None:
        super().__init__(visual, initial_sigma, diffuse_class)
        self.audio = audio
        self.log_beta = nn.Parameter(torch.tensor(math.log(initial_beta)))

    def concentration(self, feature_bcdt: Tensor, w_bkd: Tensor) -> Tensor:
        """Concentrations of q(pi | x, w), (B..., K)."""
        level_bk = self.audio.levels(feature_bcdt, w_bkd / w_bkd.sum(-1, keepdim=True))
        # Networks may run in lower precision (autocast); a Dirichlet may not.
        level_bk = level_bk.to(self.log_beta.dtype)
        return (self.log_beta.exp() * level_bk).clamp_min(LEAST_CONCENTRATION)

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
        return GuideParameters(mu_bkd, self.sigma(mu_bkd), concentration_bk, activation_bkij)
