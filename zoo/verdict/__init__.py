"""The verdict on a network, for the terminal, `metrics.json` and the report."""
