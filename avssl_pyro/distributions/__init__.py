"""Distributions of the spatial mixture and MAP-EM under them."""
