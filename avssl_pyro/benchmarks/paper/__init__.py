"""The paper's experiment: its scenes, its Tables I-III and its published results."""

__all__ = [
    "experiment",
    "paper_tables",
    "published_results",
]
