"""Faults of a recording, its array and its camera."""
