"""Scores of a network from drives and replays, the verdict on it, and its report."""
