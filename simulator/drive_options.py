"""Options of `drivezoo simulator drive`."""

from dataclasses import dataclass

from simulator.world_settings import WorldSettings


@dataclass(frozen=True)
class DriveOptions(WorldSettings):
    """Keys of a drive in a window.

    Args:
        out: folder of the recording; auto is recordings/ and the time of its start.
        seed: random seed of the weather.
        start: start position in metres along the road; null for its begin.
        width: width of the window in pixels, 320..7680; its height is half of that.
        renderer: renderer of the recorded images: auto, software or opengl.
        header: whether the log begins with column names, as the course's sample data does.
        relative: whether the log has paths relative to its folder (IMG/...).
        seconds: seconds of driving until the end; 0 for no end.
    """

    out: str = "auto"

    seed: int = 0
    start: float | None = None
    width: int = 1280
    renderer: str = "auto"
    header: bool = False
    relative: bool = False
    seconds: float = 0.0
