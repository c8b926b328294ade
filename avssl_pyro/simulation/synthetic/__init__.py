"""Material made in code: people, rooms and speech for simulations without assets."""

__all__ = [
    "people",
    "rooms",
    "speech",
    "textures",
]
