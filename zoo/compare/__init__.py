"""Comparison of two results of the benchmark: `drivezoo compare`."""
