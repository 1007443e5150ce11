"""Networks, training, driving, scoring, reporting."""

from datamodules.early_interrupt import stop_quietly

__version__ = "0.1.0"

stop_quietly("zoo")
