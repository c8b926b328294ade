"""Arrays, direction grid, steering vectors, STFT and spatial covariance."""

__all__ = [
    "array",
    "channel_gains",
    "compatibility",
    "covariance",
    "grid",
    "measured",
    "presets",
    "room_templates",
    "sofa",
    "spherical",
    "steering",
    "steering_kinds",
    "stft",
    "stft_config",
]
