"""Monte-Carlo dropout and ensembles, written as checkpoints that know their spread."""
