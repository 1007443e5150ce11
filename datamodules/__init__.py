"""Recordings to batches; knows nothing of networks, training or driving."""
