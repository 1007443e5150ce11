"""Scores by driving in the embedded world, and on recordings: `python -m zoo.evaluate`."""
