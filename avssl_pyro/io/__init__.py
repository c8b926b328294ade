"""Input and output of audio, images, video and tables."""
