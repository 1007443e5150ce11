"""Recordings to batches; knows nothing of networks, training or driving."""

from zoo.base.early_interrupt import stop_quietly

stop_quietly("datamodules")
