"""The weights that come with the package: trained without labels on simulated scenes, see ``weights/MODEL_CARD.md``."""

from dataclasses import dataclass, replace
from importlib.resources import as_file, files

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import is_same_array
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.systems.checkpoint import load_checkpoint
from avssl_pyro.systems.config import MOST_GENERAL, PRETRAINED
from avssl_pyro.systems.system import System, build_system


@dataclass(frozen=True)
class Pretrained:
    """A system with shipped weights.

    Args:
        system: model and guide for the given array, in evaluation mode.
        trained_with: name of the array the weights were trained with.
        native: whether that is the given array. If not, only the audio network suffers, which was trained on other
            beams; the visual network and refined posteriors do not depend on it.
    """

    system: System
    trained_with: str
    native: bool

    @property
    def sentence(self) -> str:
        """A sentence for the user on the origin of the weights."""
        array = self.system.config.array.name
        if self.native:
            return f"using the weights that come with the package for array '{array}'."
        return (
            f"no weights come with the package for array '{array}'; using the visual network of '{self.trained_with}', "
            "which any array can share (refined answers are as good as ever, those of one forward pass a little worse)."
        )


def load_pretrained(array: MicrophoneArray) -> Pretrained:
    """The shipped system of an array, or the most general one fitted to its geometry."""
    for name in PRETRAINED:
        if is_same_array(PRESETS[name], array):
            return Pretrained(load_weights_of(name), name, native=True)
    general = load_weights_of(MOST_GENERAL)
    system = build_system(replace(general.config, array=array))
    system.load_state_dict(general.state_dict())
    system.model.eval()
    system.guide.eval()
    return Pretrained(system, MOST_GENERAL, native=False)


def load_weights_of(name: str) -> System:
    """The system trained with the array of that name, one of ``PRETRAINED``."""
    with as_file(files("avssl_pyro") / "weights" / f"{name}.safetensors") as path:
        return load_checkpoint(path)
