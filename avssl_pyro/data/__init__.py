"""Clips, shards and their readers."""
