"""Runtime monitoring: scores of unusual frames, and the guard that slows the car by them."""

MOST_SAMPLES = 256  # of Monte-Carlo dropout for each frame
