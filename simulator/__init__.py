"""The embedded simulator: tracks, a car, its cameras, an expert and a recorder, without a display."""
