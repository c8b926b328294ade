"""Simulated scenes and recordings: rooms, people, panoramas, speech and acoustics."""

__all__ = [
    "assets",
    "compositing",
    "dialogue",
    "diffuse_field",
    "layout",
    "motion",
    "moving_source",
    "noise",
    "panoramas",
    "people",
    "plane_waves",
    "recordings",
    "reverberation",
    "room_models",
    "scene_config",
    "scenes",
    "speech",
    "synthetic",
]
