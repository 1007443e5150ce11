"""Recordings into batches. Knows nothing of networks, training or driving."""
