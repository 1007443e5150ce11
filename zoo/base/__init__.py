"""What every room needs: errors, bounded readers, whole-file writers, folders, processes."""

__version__ = "0.1.0"
