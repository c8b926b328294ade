"""Commands: each parses its options, calls the library, and prints."""

__all__ = [
    "app",
    "benchmark",
    "command",
    "demo",
    "doctor",
    "evaluate",
    "gallery",
    "localize",
    "localize_recording",
    "options",
    "outputs",
    "prepare",
    "score",
    "simulate",
    "simulate_recordings",
    "train",
]
