"""The settings of a refinement."""

from attrs import field, frozen

from avssl_pyro.validators import at_least


@frozen
class RefinementConfig:
    """How far and on what a posterior is refined.

    Args:
        rounds: most rounds of MAP-EM.
        tolerance: a clip has arrived when its log posterior per time-frequency bin rises by less in a round.
        softening: the networks' log-weights are multiplied by it to start with; a start that is too sure of itself
            locks in, one that is flat forgets the picture.
        image_weight: prior mean of log w, from 0 (the model's own prior) to 1 (the visual network's mu). The picture
            decides where the climb starts in any case; with a weight it also holds it back.
        extra_classes: source classes added to those of the networks; they start looking everywhere alike.
        bin_step, frame_step: every how many frequencies and frames are used; neighbours tell nearly the same.

    >>> RefinementConfig(rounds=120).rounds
    120
    """

    rounds: int = field(default=30, validator=at_least(1))
    tolerance: float = 1e-4
    softening: float = 0.8
    image_weight: float = 0.0
    extra_classes: int = field(default=0, validator=at_least(0))
    bin_step: int = field(default=1, validator=at_least(1))
    frame_step: int = field(default=1, validator=at_least(1))
