"""Long recordings of audio and video, and the clips cut from them."""

__all__ = [
    "candidates",
    "collection",
    "discovery",
    "excerpts",
    "labeled_recordings",
    "preparation",
    "recording",
    "split",
    "starss23",
    "starss23_writer",
]
