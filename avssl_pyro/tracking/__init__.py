"""Sources over time: from windows to tracks."""
