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
        weight: weight of the cross-entropy of directions, in nats per clip, relative to the ELBO per time-frequency
            bin; 0 turns it off.
        level_weight: weight of the cross-entropy of levels, in nats per clip; without effect on a guide without an
            audio network.
        rounds: number of rounds of MAP-EM for a target.
        softening: factor of the log-weights at the start, as in a refinement.
        smoothing_deg: standard deviation in degrees of the kernel that smooths targets over directions.
        warmup: share of the training over which the weights rise from 0, since early targets are uninformative.
        frame_step: stride in frames over those used for targets.
    """

    weight: float = attrs.field(default=0.0, validator=at_least(0))
    level_weight: float = attrs.field(default=0.0, validator=at_least(0))
    rounds: int = attrs.field(default=10, validator=at_least(1))
    softening: float = 0.6
    smoothing_deg: float = attrs.field(default=5.0, validator=between(0, 180))
    warmup: float = attrs.field(default=0.15, validator=within(0, 1))
    frame_step: int = attrs.field(default=2, validator=at_least(1))

    def strength_at(self, step: int, total_steps: int) -> float:
        """Returns the factor of the weights at a training step; 0 without distillation."""
        return min(1.0, step / max(1.0, self.warmup * total_steps)) if self.weight or self.level_weight else 0.0


@attrs.frozen
class OptimizationConfig:
    """Settings of the optimiser and of the loop over the data.

    Args:
        epochs: number of passes over the data.
        batch_size: number of clips per process and step.
        learning_rate: highest learning rate of AdamW.
        weight_decay: weight decay of AdamW.
        warmup_steps: number of steps over which the learning rate rises from 0.
        final_learning_rate: learning rate of the last step as a share of the highest; it falls along a cosine.
        gradient_clip: largest norm of the gradient of the loss: ELBO per time-frequency bin, and distillation if any.
        seed: seed of weights, noise and the order of clips.
        num_workers: number of processes that read ahead for a GPU; 0, faster on few cores, reads in the training
            process.
        log_every: number of steps between log records.
        checkpoint_minutes: time between checkpoints in minutes.
        freeze_visual: flag that keeps the weights of the visual network, for a start from another array's system.
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
    """Train the visual and the audio network on clips without labels.

    Without --data, a small set of scenes is rendered into --cache first. After an interruption, the same command
    continues where it stopped.
    """

    preset: Literal["quick", "two-cores", "paper", "museum", "adapt"] = "quick"
    """Preset that sets the defaults below. quick takes a few minutes on two cores, two-cores an hour. paper is the
    original experiment, for a GPU (20000 scenes, 200 epochs); museum is the one on recordings, cut by 'avssl prepare'.
    adapt takes a few minutes from the pretrained weights to those of your recordings and your array."""
    out: Path = Path("runs/train")
    """Folder of the run: checkpoint, log, curves, TensorBoard events."""
    data: tuple[Path, ...] = ()
    """Folders of shards made by 'avssl simulate' or 'avssl prepare'; by default a small set rendered into --cache."""
    cache: Path = Path("cache")
    """Folder of the default set."""
    num_scenes: int = 3000
    """Number of scenes in the default set."""
    condition: Literal["all-speak", "some-silent", "wide"] = "some-silent"
    """Condition of the default set."""
    array: str = "circle6"
    """Microphone array: a preset (docs/arrays.md), a YAML file, or "data" for the array of the clips in --data."""
    start_from: str | None = None
    """Checkpoint of initial weights, of the same networks and any array; circle2, circle4 and circle6 are the
    pretrained weights. By default random weights, or circle6 with --preset adapt."""
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
    """Number of processes on this machine, one per device."""
    num_nodes: int = 1
    """Number of machines."""
    precision: Literal["32-true", "bf16-mixed"] = "32-true"
    """Precision of the networks; the likelihood is always computed in 32 bits or more."""


# A quarter of the frequencies, where speech is loud, and less overlap of frames train several times as fast. Without a
# room in the model, a quarter up to 4 kHz localized no worse than all. With eight sectors, two people rarely compete
# for one class; a ninth class models diffuse noise.
_FAST = TrainingConfig(
    model=ModelConfig(num_sources=9, bin_weight=3.0, diffuse=0.01, room=True),
    guide=GuideConfig(diffuse_class=True, anchor_gain=3.0, augment=True),
    stft=StftConfig(hop=256, low_hz=200.0, high_hz=7000.0, bin_step=3),
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
    # Sec. V: eight classes for a crowd and exhibits, and a level prior that is not sparse.
    "museum": TrainingConfig(
        preset="museum",
        array=ARRAY_OF_DATA,
        model=ModelConfig(num_sources=8, alpha=1.0, sigma=1.0, diffuse=0.1),
        optimization=OptimizationConfig(epochs=200, warmup_steps=0, final_learning_rate=1.0),
    ),
    # A visual network trained on thousands of rooms would overfit to a few minutes of recordings.
    "adapt": replace(
        _FAST,
        preset="adapt",
        array=ARRAY_OF_DATA,
        start_from=MOST_GENERAL,
        optimization=OptimizationConfig(epochs=5, warmup_steps=20, freeze_visual=True),
    ),
}
