"""ELBO terms, closed forms, training, checkpoints and localization."""
