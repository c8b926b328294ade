"""Sources over time: from windows to tracks."""

__all__ = [
    "hmm_filter",
    "multi_target",
    "online",
    "recording_localizer",
    "results",
    "timeline",
    "tracker",
]
