"""Overlays, plots and annotated video."""

__all__ = [
    "activation",
    "annotated_video",
    "azimuth_strip",
    "contact_sheet",
    "frame_annotator",
    "overlay",
    "palette",
    "panorama_axes",
    "plots",
    "polar",
    "source_table",
    "sprites",
]
