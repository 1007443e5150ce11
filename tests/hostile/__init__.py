"""Inputs of a stranger: nothing of theirs runs, and nothing is written where it must not be."""
