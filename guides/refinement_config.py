"""Settings of a refinement."""

from attrs import field, frozen

from avssl_pyro.validators import at_least, between


@frozen
class RefinementConfig:
    """Settings of a refinement by MAP-EM.

    Args:
        rounds: most rounds of MAP-EM.
        tolerance: gain of a round in log posterior per time-frequency bin below which a clip stops.
        softening: factor of the networks' log-weights at the start; too large a factor fixes the classes, too small a
            factor discards the picture.
        image_weight: prior mean of log w, from 0 (the model's own prior) to 1 (the visual network's mu). The start
            depends on the picture in any case.
        extra_classes: number of classes added to those of the networks; they start with equal weights.
        diffuse_start: share of diffuse sound that every class starts with, where the model has a room.
        bin_step, frame_step: strides over frequencies and frames; neighbours are nearly redundant.

    >>> RefinementConfig(rounds=120).rounds
    120
    """

    rounds: int = field(default=40, validator=at_least(1))
    tolerance: float = 1e-4
    softening: float = 0.8
    image_weight: float = 0.0
    extra_classes: int = field(default=0, validator=at_least(0))
    diffuse_start: float = field(default=0.08, validator=between(0, 1))
    bin_step: int = field(default=1, validator=at_least(1))
    frame_step: int = field(default=1, validator=at_least(1))
