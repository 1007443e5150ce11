"""Keras networks as checkpoints, and the search for the input that each was trained with."""
