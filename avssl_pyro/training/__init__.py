"""Stochastic variational inference over a data set."""
