"""Settings of a training run, and their presets."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import attrs

from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.systems.config import MOST_GENERAL, GuideConfig, ModelConfig
from avssl_pyro.validators import at_least, between, positive, within

ARRAY_OF_DATA = "data"


@attrs.frozen
class DistillationConfig:
    """Settings of the distillation of refined posteriors into the guide.

    Args:
        weight: weight of the cross-entropy of directions (nats per clip) relative to the ELBO per time-frequency bin; 0
            turns it off.
        level_weight: weight of the cross-entropy of levels (nats per clip); without effect on a guide without an audio
            network.
        rounds: rounds of MAP-EM behind a target.
        softening: factor of the log-weights at the start, as in a refinement.
        smoothing_deg: standard deviation of the kernel that targets are smoothed with over directions, degrees.
        warmup: share of the training over which the weights rise from 0; early targets are of no use.
        frame_step: stride over the frames used for targets.
    """

    weight: float = attrs.field(default=0.0, validator=at_least(0))
    level_weight: float = attrs.field(default=0.0, validator=at_least(0))
    rounds: int = attrs.field(default=10, validator=at_least(1))
    softening: float = 0.6
    smoothing_deg: float = attrs.field(default=5.0, validator=between(0, 180))
    warmup: float = attrs.field(default=0.15, validator=within(0, 1))
    frame_step: int = attrs.field(default=2, validator=at_least(1))

    def strength_at(self, step: int, total_steps: int) -> float:
        """Factor of the weights at a step of the training; 0 without distillation."""
        return min(1.0, step / max(1.0, self.warmup * total_steps)) if self.weight or self.level_weight else 0.0


@attrs.frozen
class OptimizationConfig:
    """Settings of the optimiser and of the loop over the data.

    Args:
        epochs: passes over the data.
        batch_size: clips per process and step.
        learning_rate: highest learning rate of AdamW.
        weight_decay: weight decay of AdamW.
        warmup_steps: steps over which the learning rate rises from 0.
        final_learning_rate: learning rate of the last step as a share of the highest; a cosine leads there.
        gradient_clip: largest norm of the gradient of the loss: the ELBO per time-frequency bin and, if any, targets.
        seed: seed of weights, noise and order.
        num_workers: processes that read ahead, of use to a GPU; 0 reads in the training process, faster on few cores.
        log_every: steps between log records.
        checkpoint_minutes: minutes between checkpoints.
        freeze_visual: whether the visual network keeps its weights; for a start from another array's system.
    """

    epochs: int = attrs.field(default=5, validator=at_least(1))
    batch_size: int = attrs.field(default=16, validator=at_least(1))
    learning_rate: float = attrs.field(default=1e-3, validator=positive)
    weight_decay: float = 1e-2
    warmup_steps: int = 100
    final_learning_rate: float = 0.02
    gradient_clip: float = attrs.field(default=1.0, validator=positive)
    seed: int = attrs.field(default=0, validator=at_least(0))
    num_workers: int = attrs.field(default=0, validator=at_least(0))
    log_every: int = attrs.field(default=10, validator=at_least(1))
    checkpoint_minutes: float = 3.0
    freeze_visual: bool = False


@dataclass(frozen=True)
class TrainingConfig:
    """Trains the visual and the audio network on clips without labels.

    Without ``data`` a small set of scenes is rendered first and kept in ``cache``. Stopped at any moment (ctrl-C, or
    killed), the same training goes on where it stopped.
    """

    preset: Literal["quick", "two-cores", "paper", "museum", "adapt"] = "quick"
    """Where the defaults below come from: quick is a few minutes on two cores, two-cores an hour, paper the original
    experiment (20000 scenes, 200 epochs), for a GPU; museum is its one on recordings, which prepare.py makes ready;
    adapt is a few minutes from the weights that come with the package to those of your recordings and your array."""
    out: Path = Path("runs/train")
    """Folder of the run: checkpoint, log, curves, TensorBoard events."""
    data: tuple[Path, ...] = ()
    """Folders of shards made by simulate.py or prepare.py; by default a small set made here."""
    cache: Path = Path("cache")
    """Where the default set is kept."""
    num_scenes: int = 3000
    """Size of the default set."""
    condition: Literal["all-speak", "some-silent"] = "some-silent"
    """Condition of the default set."""
    array: str = "circle6"
    """Microphone array: a preset (docs/arrays.md) or a YAML file; "data" is the array that the
    clips of --data were made with."""
    start_from: str | None = None
    """Begin with the weights of this checkpoint, of the same networks and perhaps another array; circle2, circle4 and
    circle6 are those that come with the package."""
    estimator: Literal["mean-field", "trace"] = "mean-field"
    """Pyro's ELBO estimator: TraceMeanField_ELBO (analytic KL) or Trace_ELBO."""
    model: ModelConfig = field(default_factory=ModelConfig)
    guide: GuideConfig = field(default_factory=GuideConfig)
    stft: StftConfig = field(default_factory=StftConfig)
    targets: DistillationConfig = field(default_factory=DistillationConfig)
    optimization: OptimizationConfig = field(default_factory=OptimizationConfig)
    accelerator: Literal["auto", "cpu", "cuda"] = "auto"
    """Lightning Fabric accelerator: auto is cuda if there is one, else cpu."""
    devices: int = 1
    """Processes on this machine, one per device."""
    num_nodes: int = 1
    """Machines."""
    precision: Literal["32-true", "bf16-mixed"] = "32-true"
    """Precision of the networks; the likelihood is always computed in 32 bits or more."""


# A quarter of the frequencies, where speech is loud and the array not yet ambiguous, and less overlap of windows train
# six times as fast and localize no worse. Eight sectors leave few in which two people compete for one class; a
# separate class models diffuse noise.
_FAST = TrainingConfig(
    model=ModelConfig(num_sources=9, bin_weight=3.0),
    guide=GuideConfig(diffuse_class=True, anchor_gain=3.0, augment=True),
    stft=StftConfig(hop=256, low_hz=200.0, high_hz=4000.0, bin_step=2),
    targets=DistillationConfig(weight=0.03, level_weight=4.0),
)
PRESETS: dict[str, TrainingConfig] = {
    "quick": replace(_FAST, optimization=OptimizationConfig(epochs=3)),
    "two-cores": replace(_FAST, preset="two-cores", num_scenes=16_000, optimization=OptimizationConfig(epochs=4)),
    "paper": TrainingConfig(
        preset="paper",
        num_scenes=20_000,
        optimization=OptimizationConfig(epochs=200, warmup_steps=0, final_learning_rate=1.0),
    ),
    # Sec. V: eight classes for a crowd and exhibits, and levels that need not be sparse.
    "museum": TrainingConfig(
        preset="museum",
        array=ARRAY_OF_DATA,
        model=ModelConfig(num_sources=8, alpha=1.0, sigma=1.0, diffuse=0.1),
        optimization=OptimizationConfig(epochs=200, warmup_steps=0, final_learning_rate=1.0),
    ),
    # A few minutes of a recording would spoil a visual network that has seen thousands of rooms.
    "adapt": replace(
        _FAST,
        preset="adapt",
        array=ARRAY_OF_DATA,
        start_from=MOST_GENERAL,
        optimization=OptimizationConfig(epochs=5, warmup_steps=20, freeze_visual=True),
    ),
}
