"""The verdict on a network, in the terminal, in `metrics.json` and on top of the report."""
