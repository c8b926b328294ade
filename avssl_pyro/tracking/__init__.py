"""Tracking of sources over the windows of a recording."""

__all__ = [
    "hmm_filter",
    "multi_target",
    "online",
    "recording_localizer",
    "results",
    "timeline",
    "tracker",
]
