"""Guides: variational posteriors of the models."""
