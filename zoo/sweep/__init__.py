"""Sweeps: many runs of one command, finished even where single runs fail."""
