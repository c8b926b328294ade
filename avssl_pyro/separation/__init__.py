"""Separation: the sound of each localized source."""

__all__ = [
    "beamforming",
    "masks",
    "separator",
]
