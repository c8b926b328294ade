"""Localization of clips: posteriors, sources and results."""

__all__ = [
    "direct_level",
    "localizer",
    "posterior",
    "results",
    "spread",
]
