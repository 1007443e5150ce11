"""Formats of recordings: a reader each, and the writers of `drivezoo convert`."""
