"""Hostile input: files, sockets and requests that are written to do harm."""
