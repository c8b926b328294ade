"""Long recordings: audio and video of one place, and the clips cut from them."""
