"""Experiments: who does better, on which material."""
