"""Experiments on many clips or recordings, and their tables."""
