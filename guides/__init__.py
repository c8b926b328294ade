"""Guides: variational posteriors of the models; written to be read and swapped."""
