"""An array, a model, a guide and weights that belong together."""
