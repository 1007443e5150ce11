"""Scores of a network from drives in the embedded world and from replays of recordings."""
