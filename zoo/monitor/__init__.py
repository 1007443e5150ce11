"""Runtime monitoring: scores of how unusual a frame is, and the guard that slows the car by them."""
