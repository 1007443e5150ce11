"""Shards of images in a folder or on S3, and drives and sweeps on clusters of Ray and Slurm."""
