"""Generative models and their priors; written to be read and swapped."""
