"""Timings of `make bench`, measurements that the manual quotes, and studies."""
