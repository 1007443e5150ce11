"""Training on what an expert or a person would have done where a checkpoint went wrong."""
