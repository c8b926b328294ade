"""The hidden Markov model of one moving source."""
