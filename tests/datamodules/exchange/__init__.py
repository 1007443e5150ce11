"""Exchange of recordings with other programs."""
