"""Tests of zoo.driving, over real sockets."""
