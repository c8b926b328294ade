"""Settings of model and guide, and the names of the pretrained systems."""

from attrs import field, frozen

from avssl_pyro.validators import Requirement, at_least, positive

# Arrays whose weights come with the package.
PRETRAINED = ("circle2", "circle4", "circle6")
# The pretrained system whose visual network serves every other array: it was trained with the most microphones.
MOST_GENERAL = "circle6"
# The least eps at which covariance matrices stay invertible in complex64; a test holds it equal to the distribution's.
LEAST_DIFFUSE = 1e-3
_WIDTHS = Requirement(lambda widths: len(widths) > 1 and min(widths) >= 1, "two or more widths of at least 1")
_PROBABILITY = Requirement(lambda value: 0 <= value < 1, "at least 0 and below 1")


@frozen
class ModelConfig:
    """Settings of the generative model and its priors.

    Args:
        num_sources: number of source classes K, one for diffuse noise included.
        num_directions: number of directions D of the horizontal grid.
        alpha: concentration of the Dirichlet prior of mixing levels (alpha_0).
        sigma: scale of the log-normal prior of direction weights (sigma_0).
        diffuse: diffuse power relative to the summed weights (epsilon).
        bin_weight: multiplicity of every observed time-frequency bin, where the STFT leaves some out.
        room: whether every class has a share of sensor noise and of an isotropic field, talkers may be a little above
            or below the horizon, and onsets count more than what may be their reverberation.
    """

    num_sources: int = field(default=4, validator=at_least(1))
    num_directions: int = field(default=72, validator=at_least(1))
    alpha: float = field(default=0.01, validator=positive)
    sigma: float = field(default=1.0, validator=positive)
    diffuse: float = field(default=0.1, validator=at_least(LEAST_DIFFUSE))
    bin_weight: float = field(default=1.0, validator=positive)
    room: bool = False


@frozen
class GuideConfig:
    """Settings of the guide and its networks.

    Args:
        audio_net: whether the audio network estimates mixing levels; without it they are 1/K ("w/o Aud").
        visual_channels: width of the U-Net at every level, at least two.
        audio_channels: width of the audio network.
        dropout: dropout probability in both networks.
        circular: whether the visual network joins the left and right edges of the image.
        position_channels: whether the visual network gets the azimuth of each pixel.
        anchor_gain: height of the bump of log-weight that gives every class of the visual network a separate sector at
            the start; 0 for none.
        augment: whether the visual network trains on pictures turned and mirrored at random.
        initial_sigma: sigma_k before training.
        initial_beta: beta before training.
        diffuse_class: whether one of the source classes has equal direction weights, for diffuse noise.
    """

    audio_net: bool = True
    visual_channels: tuple[int, ...] = field(default=(16, 32, 48, 64), validator=_WIDTHS)
    audio_channels: int = field(default=48, validator=at_least(1))
    dropout: float = field(default=0.1, validator=_PROBABILITY)
    circular: bool = True
    position_channels: bool = True
    anchor_gain: float = field(default=0.0, validator=at_least(0))
    augment: bool = False
    initial_sigma: float = field(default=0.3, validator=positive)
    initial_beta: float = field(default=100.0, validator=positive)
    diffuse_class: bool = False
