"""Localization of clips: posteriors, sources and results."""
