"""Checkpoints with their cards in repositories of the Hugging Face Hub."""
