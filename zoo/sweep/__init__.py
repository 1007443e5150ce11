"""Sweeps: many runs of one command, that finish whatever happens."""
