"""Checkpoints of Keras networks, and the search for the input that each was trained with."""
