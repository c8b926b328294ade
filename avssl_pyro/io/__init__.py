"""Input and output of audio, images, video and tables."""

__all__ = [
    "audio",
    "csv_table",
    "dcase",
    "images",
    "projection_check",
    "video_reader",
    "video_writer",
]
