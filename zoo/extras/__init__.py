"""Extras: each folder joins the core by entry points, and can be deleted with its tests."""
