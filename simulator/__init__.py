"""The embedded simulator: tracks, a car, its cameras, an expert, a recorder; no display needed."""
