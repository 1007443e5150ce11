"""The server that drives simulators on a socket with a checkpoint: `drivezoo drive`."""

import warnings

# eventlet prints this at each import. It serves the original client at 60 frames per second, and
# users of the driver cannot choose another library.
warnings.filterwarnings("ignore", message=r"\s*Eventlet is deprecated")
