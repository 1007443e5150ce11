"""One training, from its config to its best checkpoint, scores and report."""
