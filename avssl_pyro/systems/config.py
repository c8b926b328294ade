"""The settings of a model and of a guide, and the names of the pretrained systems."""

import math
from dataclasses import dataclass

from avssl_pyro.errors import InputError

# Arrays whose weights come with the package.
PRETRAINED = ("circle2", "circle4", "circle6")
# The pretrained system whose visual network serves every other array: it was trained with the most microphones.
MOST_GENERAL = "circle6"
# The least eps at which covariance matrices stay invertible in complex64; a test holds it equal to the distribution's.
LEAST_DIFFUSE = 1e-3


@dataclass(frozen=True)
class ModelConfig:
    """The generative model and its priors.

    Args:
        num_sources: K, source classes including one for diffuse noise.
        num_directions: D, directions of the horizontal grid.
        alpha: concentration of the Dirichlet prior of mixing levels (alpha_0).
        sigma: scale of the log-normal prior of direction weights (sigma_0).
        diffuse: diffuse power relative to the summed weights (epsilon).
        bin_weight: every observed time-frequency bin stands for so many, where the STFT leaves some out.
    """

    num_sources: int = 4
    num_directions: int = 72
    alpha: float = 0.01
    sigma: float = 1.0
    diffuse: float = 0.1
    bin_weight: float = 1.0

    def __post_init__(self) -> None:
        for name in ("num_sources", "num_directions"):
            _require(self, name, getattr(self, name) >= 1, "at least 1")
        for name in ("alpha", "sigma", "bin_weight"):
            _require(self, name, 0 < getattr(self, name) < math.inf, "positive")
        _require(self, "diffuse", LEAST_DIFFUSE <= self.diffuse < math.inf, f"at least {LEAST_DIFFUSE:g}")


@dataclass(frozen=True)
class GuideConfig:
    """The guide and its networks.

    Args:
        audio_net: estimate mixing levels with the audio network; without it they are 1/K ("w/o Aud").
        visual_channels: width of the U-Net at every level, at least two.
        audio_channels: width of the audio network.
        dropout: dropout probability in both networks.
        circular: join the left and right image edges in the visual network.
        position_channels: show the visual network each pixel's azimuth.
        anchor_gain: give every class of the visual network a sector of its own to start with, by a bump of log-weight
            of this height; 0 for none.
        augment: train the visual network on pictures turned and mirrored at random.
        initial_sigma: sigma_k before training.
        initial_beta: beta before training.
        diffuse_class: keep one of the source classes for diffuse noise, its direction weights all alike.
    """

    audio_net: bool = True
    visual_channels: tuple[int, ...] = (16, 32, 48, 64)
    audio_channels: int = 48
    dropout: float = 0.1
    circular: bool = True
    position_channels: bool = True
    anchor_gain: float = 0.0
    augment: bool = False
    initial_sigma: float = 0.3
    initial_beta: float = 100.0
    diffuse_class: bool = False

    def __post_init__(self) -> None:
        widths = self.visual_channels
        _require(self, "visual_channels", len(widths) > 1 and min(widths) >= 1, "two or more widths of at least 1")
        _require(self, "audio_channels", self.audio_channels >= 1, "at least 1")
        _require(self, "dropout", 0 <= self.dropout < 1, "at least 0 and below 1")
        _require(self, "anchor_gain", 0 <= self.anchor_gain < math.inf, "at least 0")
        for name in ("initial_sigma", "initial_beta"):
            _require(self, name, 0 < getattr(self, name) < math.inf, "positive")


def _require(config: ModelConfig | GuideConfig, name: str, fulfilled: bool, what: str) -> None:
    if not fulfilled:
        raise InputError(f"{type(config).__name__}: {name} is {getattr(config, name)}; it must be {what}.")
