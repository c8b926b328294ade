"""Data sets of clips on disk: shards, their readers, and the order of training."""
