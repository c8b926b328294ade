"""Acoustics of simulated rooms: responses of arrays to sources, and diffuse sound."""

__all__ = ["diffuse_field", "models", "plane_waves", "reverberation"]
