"""Runtime monitoring: scores of unusual frames, and the guard that slows the car by them."""
