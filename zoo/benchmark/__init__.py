"""The benchmark: drives of a suite's roads, their figures with intervals, and their digest."""
