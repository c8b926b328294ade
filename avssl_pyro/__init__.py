"""Self-supervised audio-visual sound source localization with a spatial mixture model in Pyro.

>>> import avssl_pyro as av
>>> model = av.load("circle6")
>>> model.array.num_microphones
6

Importing the package costs nothing: every name is imported when it is first used.
"""

import sys
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from avssl_pyro.acoustics.array import MicrophoneArray
    from avssl_pyro.acoustics.grid import DirectionGrid
    from avssl_pyro.acoustics.stft_config import StftConfig
    from avssl_pyro.api.model import Model, load
    from avssl_pyro.api.result import Result
    from avssl_pyro.api.simulation import simulate
    from avssl_pyro.api.training import train
    from avssl_pyro.clip import Clip
    from avssl_pyro.errors import InputError
    from avssl_pyro.guides.amortized import AmortizedGuide
    from avssl_pyro.guides.per_clip import PerClipGuide
    from avssl_pyro.guides.refined import RefinedGuide
    from avssl_pyro.guides.refinement_config import RefinementConfig
    from avssl_pyro.localization.direct_level import DirectLevelRule
    from avssl_pyro.localization.localizer import Localizer
    from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource
    from avssl_pyro.models.likelihoods import PrecedenceGaussian, ProfiledGaussian
    from avssl_pyro.models.priors import LogNormalWeights, SparseDirichlet
    from avssl_pyro.models.room import Room
    from avssl_pyro.models.spatial_cgmm import SpatialCGMM
    from avssl_pyro.recordings.recording import Alignment
    from avssl_pyro.separation.separator import Separator
    from avssl_pyro.systems.system import System, SystemConfig
    from avssl_pyro.tracking.timeline import Timeline

__version__ = "0.1.0"

# The module of every public name.
_MODULES = {
    "Alignment": "recordings.recording",
    "AmortizedGuide": "guides.amortized",
    "Clip": "clip",
    "ClipPosterior": "localization.posterior",
    "DirectLevelRule": "localization.direct_level",
    "DirectionGrid": "acoustics.grid",
    "InputError": "errors",
    "LocalizedSource": "localization.posterior",
    "Localizer": "localization.localizer",
    "LogNormalWeights": "models.priors",
    "MicrophoneArray": "acoustics.array",
    "Model": "api.model",
    "PerClipGuide": "guides.per_clip",
    "PrecedenceGaussian": "models.likelihoods",
    "ProfiledGaussian": "models.likelihoods",
    "RefinedGuide": "guides.refined",
    "RefinementConfig": "guides.refinement_config",
    "Result": "api.result",
    "Room": "models.room",
    "Separator": "separation.separator",
    "SparseDirichlet": "models.priors",
    "SpatialCGMM": "models.spatial_cgmm",
    "StftConfig": "acoustics.stft_config",
    "System": "systems.system",
    "SystemConfig": "systems.system",
    "Timeline": "tracking.timeline",
    "load": "api.model",
    "simulate": "api.simulation",
    "train": "api.training",
}

__all__ = [
    "Alignment",
    "AmortizedGuide",
    "Clip",
    "ClipPosterior",
    "DirectLevelRule",
    "DirectionGrid",
    "InputError",
    "LocalizedSource",
    "Localizer",
    "LogNormalWeights",
    "MicrophoneArray",
    "Model",
    "PerClipGuide",
    "PrecedenceGaussian",
    "ProfiledGaussian",
    "RefinedGuide",
    "RefinementConfig",
    "Result",
    "Room",
    "Separator",
    "SparseDirichlet",
    "SpatialCGMM",
    "StftConfig",
    "System",
    "SystemConfig",
    "Timeline",
    "load",
    "simulate",
    "train",
]


# Hidden from type checkers, which would otherwise accept any name.
if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        if name not in _MODULES:
            raise AttributeError(f"module 'avssl_pyro' has no attribute '{name}'")
        value = globals()[name] = getattr(import_module(f"avssl_pyro.{_MODULES[name]}"), name)
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _CheckoutFinder(MetaPathFinder):
    """Finds `avssl_pyro.models` and `avssl_pyro.guides` one level up, where they lie in a checkout."""

    def __init__(self, checkout: Path) -> None:
        self._folders = {f"avssl_pyro.{name}": checkout / name for name in ("models", "guides")}

    def find_spec(self, fullname: str, *_: object) -> ModuleSpec | None:
        folder = self._folders.get(fullname)
        if folder is None:
            return None
        return spec_from_file_location(fullname, folder / "__init__.py", submodule_search_locations=[str(folder)])


# Started from a checkout, the package on disk shadows an installed one. Without this finder its models and guides would
# come from the installed one, or from nowhere.
_checkout = Path(__file__).resolve().parent.parent
if (_checkout / "models" / "spatial_cgmm.py").is_file():
    sys.meta_path.insert(0, _CheckoutFinder(_checkout))
