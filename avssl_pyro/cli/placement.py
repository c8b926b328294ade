"""Options that say how a recording's picture and sound lie to each other, alike for every command that reads some."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.recordings.discovery import Alignment


@dataclass(frozen=True)
class AlignmentOptions:
    """How picture and sound lie to each other."""

    offset: float = 0.0
    """Seconds that the audio began before the video; negative if it began later."""
    yaw: float = 0.0
    """Azimuth, in degrees counter-clockwise from the array's x axis, of what the picture's centre column shows."""
    mirror: bool = False
    """The picture shows left and right exchanged."""
    elevations: Annotated[tuple[float, float] | None, tyro.conf.arg(metavar="LOWEST HIGHEST")] = None
    """Elevations in degrees of the picture's bottom and top, if it is no full sphere."""

    def of(self, array: MicrophoneArray) -> Alignment:
        """That, with the channels that an array names."""
        channels = array.channels and array.channel_indices
        return Alignment(self.offset, self.yaw, self.mirror, self.elevations, channels)
