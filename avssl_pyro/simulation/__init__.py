"""Simulated scenes and recordings: rooms, people, panoramas, speech and acoustics."""

__all__ = [
    "assets",
    "compositing",
    "dialogue",
    "layout",
    "motion",
    "moving_source",
    "panoramas",
    "people",
    "plane_waves",
    "recordings",
    "reverberation",
    "scenes",
    "speech",
    "synthetic",
]
