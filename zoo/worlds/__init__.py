"""Worlds in which policies drive, and the only code that drives in them."""
