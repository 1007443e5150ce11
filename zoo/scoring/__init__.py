"""Scores by driving: a drive in the embedded world, its figures and its pictures."""
