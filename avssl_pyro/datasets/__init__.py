"""Data sets of clips on disk: shards, their readers, and the order of training."""

__all__ = [
    "builtin",
    "dataset",
    "encoding",
    "folder_lock",
    "generation",
    "manifest",
    "sampling",
    "scene_plan",
    "shard_reader",
    "shards",
]
