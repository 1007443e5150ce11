"""The embedded simulator as a child process that connects to the driver."""

import subprocess

from zoo.base.child_process import end_module, start_module


class EmbeddedClient:
    """Child process `drivezoo simulator client`.

    Args:
        track: track to drive on; None starts no process.
        url: address of the driver.
        laps: number of laps after which it ends; None drives until `stop`.
        put_back: whether an intervention puts the car back on the centre of the road.
    """

    def __init__(
        self, track: str | None, url: str, laps: float | None = None, put_back: bool = True
    ) -> None:
        self._track, self._options = track, [f"track={track}", f"url={url}", "truth=true"]
        self._options += [f"put_back={str(put_back).lower()}"]
        self._options += [f"laps={laps}"] if laps else []
        self._process: subprocess.Popen | None = None

    def start(self) -> None:
        """Start the process, if there is a track."""
        if self._track is not None:
            self._process = start_module("simulator", "client", *self._options)

    @property
    def ended(self) -> bool:
        """Whether the process has ended by itself."""
        return self._process is not None and self._process.poll() is not None

    def stop(self) -> int:
        """End the process if it runs; return its exit status, 0 if it was ended here."""
        if self._process is None:
            return 0
        if self.ended:
            return self._process.returncode
        end_module(self._process)  # the process closes its film
        return 0
