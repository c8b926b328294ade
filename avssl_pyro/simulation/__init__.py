"""Simulated scenes and recordings: rooms, people, panoramas, speech and acoustics."""

__all__ = [
    "acoustics",
    "assets",
    "compositing",
    "dialogue",
    "layout",
    "motion",
    "moving_source",
    "noise",
    "panoramas",
    "people",
    "recordings",
    "scene_config",
    "scenes",
    "speech",
    "synthetic",
]
