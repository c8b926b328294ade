"""Separation: the sound of each localized source."""
