"""Results beside each other: suites of roads, comparison with intervals, rankings."""
