"""The settings of one training, and the presets they start from."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from avssl_pyro.acoustics.stft import StftConfig
from avssl_pyro.systems.pretrained import MOST_GENERAL
from avssl_pyro.systems.system import GuideConfig, ModelConfig
from avssl_pyro.training.distillation import DistillationConfig
from avssl_pyro.training.svi import OptimizationConfig

ARRAY_OF_DATA = "data"


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
    scenes: int = 3000
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
# six times as fast and localize no worse. Eight sectors leave few in which two people compete for one class; a class of
# its own hears diffuse noise.
_FAST = TrainingConfig(
    model=ModelConfig(num_sources=9, bin_weight=3.0),
    guide=GuideConfig(diffuse_class=True, anchor_gain=3.0, augment=True),
    stft=StftConfig(hop=256, low_hz=200.0, high_hz=4000.0, bin_step=2),
    targets=DistillationConfig(weight=0.03, level_weight=4.0),
)
PRESETS: dict[str, TrainingConfig] = {
    "quick": replace(_FAST, optimization=OptimizationConfig(epochs=3)),
    "two-cores": replace(_FAST, preset="two-cores", scenes=16_000, optimization=OptimizationConfig(epochs=4)),
    "paper": TrainingConfig(
        preset="paper",
        scenes=20_000,
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
