"""Generative models, their priors and likelihoods."""
