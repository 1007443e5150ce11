"""Networks, training, driving, scoring, reporting."""

import sys

__version__ = "0.1.0"

if sys.argv[:1] == ["-m"]:  # so Python calls a command while it imports what the command needs
    from zoo.cli.early_interrupt import stop_quietly

    stop_quietly()
