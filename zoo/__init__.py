"""Networks, training, driving, scoring, reporting."""

__version__ = "0.1.0"
