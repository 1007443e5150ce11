"""A search for roads and conditions on which a checkpoint fails."""
