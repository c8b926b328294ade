"""Plain neural networks: tensors in, distribution parameters out."""

__all__ = [
    "audio",
    "augmentation",
    "visual",
]
