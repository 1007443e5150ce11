"""Comparison of two results of the benchmark: `python -m zoo.compare`."""
