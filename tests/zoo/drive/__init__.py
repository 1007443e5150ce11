"""Tests of zoo.drive, over real sockets."""
