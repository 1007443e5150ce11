"""Export of a checkpoint to ONNX, with a check that both steer the same: `drivezoo export`."""
