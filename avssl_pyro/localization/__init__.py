"""Localization of clips: posteriors, sources and results."""

__all__ = [
    "localizer",
    "posterior",
    "results",
]
