"""What every room needs: errors, bounded readers, whole-file writers, folders, processes."""
