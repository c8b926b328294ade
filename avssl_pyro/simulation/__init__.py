"""Simulated scenes and recordings: rooms, people, panoramas, speech and acoustics."""
