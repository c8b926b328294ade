"""The hidden Markov model of one moving source."""

__all__ = [
    "detection",
    "hmm",
    "motion",
]
