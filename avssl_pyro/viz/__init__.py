"""Overlays, plots and annotated video."""
