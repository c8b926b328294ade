"""Acoustics of simulated rooms: responses of arrays to sources, and diffuse sound."""

__all__ = ["arrivals", "diffuse_field", "models", "plane_waves", "ray_tracing", "reverberation"]
