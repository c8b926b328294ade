"""Checks of a recording against the array and the camera it is said to come from, one check a module."""
