"""Options of `drivezoo simulator record`."""

from dataclasses import dataclass

from simulator.world_settings import WorldSettings


@dataclass(frozen=True)
class RecordOptions(WorldSettings):
    """Keys of a recording.

    Args:
        out: folder to write; it must not contain a recording.
        laps: number of laps; 0.5 is half a lap. A drive on an open road ends at the road's end, so
            more than 1 counts as 1.
        control: expert (steers exactly), or a simulated student's keyboard (key taps) or mouse.
        speed: speed on straights in mph, 8..30; the driver slows down for sharp bends.
        noise: how far the driver sways off its line, 0..1; only the way back is recorded.
        direction: forward, backward, or both (one after the other).
        seed: random seed of swaying, hand inaccuracy and weather.
        start: start position in metres along the road; null for its begin.
        renderer: auto, software or opengl.
        header: whether the log begins with column names, as the course's sample data does.
        relative: whether the log has paths relative to its folder (IMG/...).
        jobs: number of processes that draw, 1..64; it does not change the files.
    """

    out: str
    laps: float = 1.0
    control: str = "expert"
    speed: float = 30.0
    noise: float = 0.0

    seed: int = 0
    start: float | None = None
    renderer: str = "auto"
    header: bool = False
    relative: bool = False
    jobs: int = 1
