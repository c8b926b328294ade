"""Plain neural networks: tensors in, distribution parameters out."""
