"""From clips to posteriors and sources."""
