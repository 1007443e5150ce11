"""Shards of images in a folder or on S3, clusters of Ray and Slurm, and sweeps by Optuna."""
