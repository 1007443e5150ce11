"""A score on a recording, without a simulator: NVIDIA's protocol.

Bojarski et al. 2016, "End to End Learning for Self-Driving Cars", section 6: a virtual car drives
beside the recorded one. At each row it sees the recorded frame warped to where it is, the network
steers it, and more than a margin off the recorded path is an intervention that puts it back there.

On a lap of the lake by the expert, the interventions of 15 checkpoints, good and bad, rank as in
the same lap driven: Spearman's coefficient is 0.93 at 30 mph and 0.98 at 15 mph; that of the mean
squared error is 0.28 and 0.14 (`python benchmarks/replay_validation.py RECORDING CKPT...`). Limits:

- The recorded path stands for the lane's middle. A person who drives beside it, or sways, makes a
  network that keeps to the middle look bad.
- Both cars roll without slip and obey at once; what a real car adds to that is not replayed.
- Of two tiny networks' and a LeNet's interventions it found a fifth to two thirds: unexplained.
- Speed is the recorded one; a network's own throttle is not tried.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.errors import InputError
from datamodules.image import read_image
from datamodules.recording import GAP_S, Recording
from simulator.rig import MAX_STEERING_DEG, MPS_PER_MPH, REAR_AXLE_M, WHEELBASE_M
from zoo.drives.drive_record import REPLAY, Drive, DriveRow
from zoo.drives.interventions import INTERVENTION_S
from zoo.evaluate.camera_warp import Warp
from zoo.evaluate.embedded_drive import Policy

MARGIN_M = 1.0  # NVIDIA's
GREATEST_MARGIN_M = 2.0  # farther off, a warped frame has little to do with what would be seen
LOST_RAD = math.radians(45)
STEP_S = 0.02
SHORTEST_S = 2 * INTERVENTION_S  # with less, a single intervention decides


@dataclass
class VirtualCar:
    """A car beside the recorded one: both roll without slip, and it keeps level along the path.

    Attributes:
        right_m: of the recorded path, at the rear axle.
        heading_rad: to the right of the recorded car's.
    """

    right_m: float = 0.0
    heading_rad: float = 0.0

    @property
    def cte_m(self) -> float:
        """Metres right of the recorded car's origin, which is between the axles."""
        return self.right_m + REAR_AXLE_M * math.sin(self.heading_rad)

    @property
    def lost(self) -> bool:
        return abs(self.heading_rad) > LOST_RAD

    def step(self, steering: float, recorded_steering: float, metres: float, steps: int) -> None:
        """Move on while the recorded car drives `metres`; steering -1..1, right positive.

        The errors of a single-track model in the path's own coordinates (Rajamani, *Vehicle
        Dynamics and Control*, 2012, ch. 2), by the midpoint rule.
        """
        own, path = curvature(steering), curvature(recorded_steering)
        part = metres / steps
        for _ in range(steps):
            right, heading = self._change(self.right_m, self.heading_rad, own, path)
            middle = (self.right_m + right * part / 2, self.heading_rad + heading * part / 2)
            right, heading = self._change(*middle, own, path)
            self.right_m += right * part
            self.heading_rad += heading * part
            if self.lost:
                return

    @staticmethod
    def _change(right: float, heading: float, own: float, path: float) -> tuple[float, float]:
        """By how much both grow in a metre of the path."""
        inside = max(1 - path * right, 0.1)
        return inside * math.tan(heading), own * inside / math.cos(heading) - path


def curvature(steering: float) -> float:
    """1/m of the rear axle's path, right positive.

    >>> round(1 / curvature(1.0), 2)
    6.15
    """
    return math.tan(math.radians(MAX_STEERING_DEG) * steering) / WHEELBASE_M


def replay(
    policy: Policy,
    recording: Recording,
    margin_m: float = MARGIN_M,
    frame_rate: float | None = None,
    show: Callable[[np.ndarray, DriveRow], None] | None = None,
) -> Drive:
    """Let a policy steer a virtual car along a recording, at the recorded speed.

    It begins anew, on the path, where the recording has a pause or another one begins. Time goes
    on from there as if there were none.

    Args:
        policy: frame uint8 [160, 320, 3] RGB and mph -> steering, and a throttle that is ignored.
        recording: in the order it was driven.
        margin_m: off the recorded path that counts as an intervention.
        frame_rate: rows a second, for a recording whose image names carry no time.
        show: is given every frame as the policy sees it, uint8 RGB, with its row.

    Raises:
        InputError: a recording without times, or too short; an image that cannot be read.
    """
    if not 0 < margin_m <= GREATEST_MARGIN_M:
        raise InputError(f"margin={margin_m:g}: must be above 0, up to {GREATEST_MARGIN_M:g} m")
    elapsed = seconds_of_rows(recording, frame_rate)
    driven_s = float(np.nansum(elapsed))
    if driven_s < SHORTEST_S:
        raise InputError(
            f"{', '.join(recording.names)}: {driven_s:.1f} s of driving without a pause; "
            f"a replay needs {SHORTEST_S:g} s, since an intervention counts for {INTERVENTION_S:g}"
        )
    speed_mps = recording.speed_mph * MPS_PER_MPH
    rows: list[DriveRow] = []
    xy: list[tuple[float, float]] = []
    distance_m: list[float] = []
    nan_frames = 0
    warp, car = Warp(), VirtualCar()
    now_s, place = 0.0, _Path()
    for row in range(len(recording)):
        frames = _Frames(recording, row)
        frame = warp(frames, frames.cameras, car.cte_m, car.heading_rad)
        began = time.perf_counter()
        steering = policy(frame, float(recording.speed_mph[row]))[0]
        latency_ms = 1000 * (time.perf_counter() - began)
        nan_frames += bool(np.isnan(steering))
        steering = float(np.clip(np.nan_to_num(steering), -1, 1))
        lost = abs(car.cte_m) > margin_m or car.lost
        shown = DriveRow(
            time_s=now_s,
            steering=steering,
            throttle=float(recording.throttle[row] - recording.brake[row]),
            speed_mph=float(recording.speed_mph[row]),
            cross_track_m=car.cte_m,
            intervention=lost,
            latency_ms=latency_ms,
        )
        rows.append(shown)
        xy.append(place.beside(car.cte_m))
        distance_m.append(place.metres)
        if show:
            show(frame, shown)
        if math.isnan(elapsed[row]):
            car = VirtualCar()
            continue
        seconds = float(elapsed[row])
        metres = float(speed_mps[row] + speed_mps[row + 1]) / 2 * seconds
        if lost:
            car = VirtualCar()
        else:
            steps = max(1, math.ceil(seconds / STEP_S))
            car.step(steering, float(recording.steering[row]), metres, steps)
        place.step(float(recording.steering[row]), metres)
        now_s += seconds
    change = float(np.abs(np.diff(recording.steering)).sum())
    return Drive.of(
        rows,
        source=REPLAY,
        track=", ".join(recording.names),
        lane_m=margin_m,
        driven_m=place.metres,
        nan_frames=nan_frames,
        expert_steering_per_s=change / now_s,
        xy=np.array(xy),
        distance_m=np.array(distance_m),
    )


def seconds_of_rows(recording: Recording, frame_rate: float | None = None) -> np.ndarray:
    """Seconds from each row to the next, float64 [N]; NaN where none follows without a pause.

    Raises:
        InputError: the recording carries no times, and `frame_rate` is None.
    """
    rows = len(recording)
    seconds = np.full(rows, np.nan)
    if frame_rate is None:
        unknown = np.flatnonzero(np.isnan(recording.time_s))
        if len(unknown):
            name = Path(str(recording.images[unknown[0], 0])).name
            raise InputError(
                f"{recording.place(unknown[0])}: {name} carries no time "
                f"({len(unknown)} of {rows} rows); say frame_rate=15 if it was 15 rows a second"
            )
        seconds[:-1] = np.diff(recording.time_s)
    elif not 1 <= frame_rate <= 100:
        raise InputError(f"frame_rate={frame_rate:g}: must be in 1..100")
    else:
        seconds[:-1] = 1 / frame_rate
        # Rows that were left out, as those with bad images are, tell by their lines.
        seconds[:-1][np.diff(recording.line) != 1] = np.nan
    other = np.diff(recording.recording) != 0
    seconds[:-1][other | ~(seconds[:-1] > 0) | (seconds[:-1] > GAP_S)] = np.nan
    return seconds


class _Frames:
    """A row's frames, decoded when asked for."""

    def __init__(self, recording: Recording, row: int) -> None:
        self.recording, self.row = recording, row
        paths = recording.images[row]
        self.cameras = [one for one, path in zip(CAMERAS, paths, strict=True) if path]
        self._decoded: dict[str, np.ndarray] = {}

    def __call__(self, camera: str) -> np.ndarray:
        if camera not in self._decoded:
            path = self.recording.images[self.row, CAMERAS.index(camera)]
            try:
                self._decoded[camera] = read_image(path)
            except (OSError, ValueError) as error:
                raise InputError(f"{self.recording.place(self.row)}: {path}: {error}") from None
        return self._decoded[camera]


class _Path:
    """The recorded way as the steering tells it, for a plot: it drifts, but bends as the road."""

    def __init__(self) -> None:
        self.metres = self.x = self.y = self.heading = 0.0

    def step(self, steering: float, metres: float) -> None:
        self.heading -= curvature(steering) * metres / 2
        self.x += metres * math.cos(self.heading)
        self.y += metres * math.sin(self.heading)
        self.heading -= curvature(steering) * metres / 2
        self.metres += metres

    def beside(self, right_m: float) -> tuple[float, float]:
        return (
            self.x + right_m * math.sin(self.heading),
            self.y - right_m * math.cos(self.heading),
        )
