"""Arrays, direction grid, steering vectors, STFT and spatial covariance."""
