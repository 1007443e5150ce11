"""Completion of commands, keys and values in a shell."""
