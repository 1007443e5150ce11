"""The checkpoint's format, the policies loaded from it, and weights from other programs."""
