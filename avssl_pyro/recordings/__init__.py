"""Long recordings of audio and video, and the clips cut from them."""

__all__ = [
    "candidates",
    "discovery",
    "excerpts",
    "labeled_recordings",
    "preparation",
    "recording",
    "split",
    "starss23",
]
