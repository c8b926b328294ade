"""Localizing by sound alone: a refinement that starts without the picture."""

from dataclasses import replace

import torch

from avssl_pyro.guides.initializers import UninformedInitializer
from avssl_pyro.guides.refined import RefinementConfig
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.systems.system import System


def without_picture(refinement: RefinementConfig) -> RefinementConfig:
    """The same without the picture: it is no prior either, and lobes need no softening as a network's mu does."""
    return replace(refinement, image_weight=0.0, softening=1.0)


def audio_only_localizer(
    system: System,
    refinement: RefinementConfig,
    device: torch.device | str = "cpu",
    pause_db: float | None = None,
) -> Localizer:
    """Refines from broad lobes around the circle; of the system, the model alone is used.

    Args:
        system: its networks are not asked.
        refinement: as with the picture; see :func:`without_picture`.
        device, pause_db: as of :class:`avssl_pyro.localization.localizer.Localizer`.
    """
    start = UninformedInitializer(system.config.model.num_sources, system.config.grid)
    return Localizer(system, device, refinement=without_picture(refinement), start=start, pause_db=pause_db)
