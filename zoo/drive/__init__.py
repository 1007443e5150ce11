"""Serving a checkpoint to simulators on a socket: `zoo.drive` is the command."""

import warnings

# Said at each import of eventlet, to programs that could choose another server. It is what serves
# the original client at 60 frames/s here, and nobody who drives can act on the advice.
warnings.filterwarnings("ignore", message=r"\s*Eventlet is deprecated")
