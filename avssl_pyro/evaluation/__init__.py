"""Metrics, baselines and methods."""
