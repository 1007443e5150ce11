"""Export of a checkpoint to ONNX, and the check that both steer alike: `python -m zoo.export`."""
