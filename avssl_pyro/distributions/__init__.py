"""Custom distributions, one a file."""
