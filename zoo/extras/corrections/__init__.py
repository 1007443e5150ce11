"""`drivezoo correct`: train a checkpoint on its own driving errors, by DAgger or a person."""
