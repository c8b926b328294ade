"""The sound of each localized source."""
