"""Neural networks from images and spectrograms to distribution parameters."""

__all__ = [
    "audio",
    "augmentation",
    "visual",
]
