"""Scores of a network from drives and replays, its verdict and report, and its exported file."""
