"""The front door: load a model, localize clips, simulate scenes, train."""
