"""The guard command: how well scores of frames warn before failures, and how many they prevent."""
