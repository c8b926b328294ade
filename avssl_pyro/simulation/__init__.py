"""Scenes made in code: rooms, people, panoramas, speech and their acoustics."""
