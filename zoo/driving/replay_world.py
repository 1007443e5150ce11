"""A recording as a world, without a simulator: NVIDIA's protocol of scoring.

Source: Bojarski et al. 2016, "End to End Learning for Self-Driving Cars", section 6. A virtual car
drives next to the recorded car. At each row, the recorded frame is warped to the virtual car's
position, and the network steers the virtual car by it. More than a margin from the recorded path is
an intervention: the car is put back on the path.

The score agrees with driving: on a lap of the lake by the expert, the rank correlation (Spearman)
of the replay's interventions with those of the same lap driven is 0.94 (95 %: 0.74 to 1.00) over 16
checkpoints, that of the mean squared error 0.82 (0.45 to 0.97). docs/offline_metrics.md has the
commands and another world. Limits:

- The recorded path counts as the centre of the lane. If the recorded driver weaves, or drives off
  the centre, a network that keeps to the centre gets a bad score.
- Both cars roll without slip and follow the steering without delay.
- It misses the few interventions of networks that nearly drive. The reason is unknown.
- The speed is the recorded one; a network's own throttle is ignored.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.image import read_image
from datamodules.recording import GAP_S, Recording
from datamodules.stretches import missing_rows
from zoo.base.errors import InputError
from zoo.base.rig import MPS_PER_MPH, RIG_KEYS, UDACITY, Rig
from zoo.driving.camera_warp import Warp
from zoo.driving.drive_record import REPLAY
from zoo.driving.interventions import INTERVENTION_S
from zoo.driving.scenario import SIMULATED, Scenario
from zoo.driving.world import State, World

MARGIN_M = 1.0  # NVIDIA's margin; on a car with a lower camera, such as a toy, the camera's height
GREATEST_MARGIN_M = 2.0  # farther off the path, a warped frame differs much from a real one
LOST_RAD = math.radians(45)  # heading error of an intervention
STEP_S = 0.02  # longest step of the car's motion
# Metres off the path up to which networks steer by a warped frame as by a real one, by the rig;
# measured on docs/offline_metrics.md.
BELIEVABLE_M = {UDACITY.name: 1.5}
SHORTEST_S = 2 * INTERVENTION_S  # in a shorter replay one intervention decides the score


@dataclass
class VirtualCar:
    """A car next to the recorded car, at the same distance along the path; both roll without slip.

    Attributes:
        rig: axles and steering of both cars.
        right_m: distance right of the recorded path at the rear axle, in metres.
        heading_rad: angle to the right of the recorded car's heading, in radians.
    """

    rig: Rig
    right_m: float = 0.0
    heading_rad: float = 0.0

    @property
    def cte_m(self) -> float:
        """Return the metres right of the recorded car's origin, which is between the axles."""
        return self.right_m + self.rig.rear_axle_m * math.sin(self.heading_rad)

    @property
    def lost(self) -> bool:
        """Whether the heading error exceeds 45 degrees."""
        return abs(self.heading_rad) > LOST_RAD

    def step(self, steering: float, recorded_steering: float, metres: float, steps: int) -> None:
        """Move the car while the recorded car drives some metres.

        The motion is that of the errors of a single-track model in coordinates of the path
        (Rajamani, *Vehicle Dynamics and Control*, 2012, ch. 2), integrated by the midpoint rule.

        Args:
            steering: steering of the virtual car, -1..1, positive is right.
            recorded_steering: steering of the recorded car, -1..1.
            metres: distance that the recorded car drives.
            steps: number of integration steps.
        """
        driven, path = self.rig.curvature(steering), self.rig.curvature(recorded_steering)
        part = metres / steps
        for _ in range(steps):
            right, heading = self._change(self.right_m, self.heading_rad, driven, path)
            middle = (self.right_m + right * part / 2, self.heading_rad + heading * part / 2)
            right, heading = self._change(*middle, driven, path)
            self.right_m += right * part
            self.heading_rad += heading * part
            if self.lost:
                return

    @staticmethod
    def _change(right: float, heading: float, driven: float, path: float) -> tuple[float, float]:
        """Return the change of `right_m` and `heading_rad` per metre of the path."""
        inside = max(1 - path * right, 0.1)
        return inside * math.tan(heading), driven * inside / math.cos(heading) - path


class ReplayWorld(World):
    """A virtual car next to a recorded one, at the recorded speed.

    After a pause, and at the start of each further recording, the car is put on the path. Pauses
    do not count as time.

    Args:
        recording: recording in the order in which it was driven, with its rig.
        frame_rate: rows per second, for a recording whose image names hold no time.
        speed_mph: speed of every row, for a recording that holds none.
        stretches: numbers of the rows to drive, int64 [N] for each stretch; None for all rows.

    Raises:
        InputError: the recording has no rig, no times or no speed, or is too short.
    """

    rig: Rig
    ignores = (*SIMULATED, "laps", "frame_rate", "speed")

    def __init__(
        self,
        recording: Recording,
        frame_rate: float | None = None,
        speed_mph: float | None = None,
        stretches: Sequence[np.ndarray] | None = None,
    ) -> None:
        names = ", ".join(recording.names)
        if (rig := recording.rig) is None:
            if unknown := ", ".join(recording.without_rig):
                raise InputError(
                    f"{unknown}: the rig is unknown, so that it cannot be replayed; describe "
                    "camera and car in rig.yaml beside it or in data.rig=FILE (drivezoo new rig "
                    f"my_car), or name a known one, {RIG_KEYS}"
                )
            raise InputError(
                f"{names}: their rigs differ, and a replay has one car; replay each recording by "
                "itself: drivezoo replay CKPT FOLDER"
            )
        self.rig, self.stretches, self.speed_mph = rig, stretches, speed_mph
        self.recording = with_speed(recording, speed_mph)
        self.elapsed_s = seconds_of_rows(self.recording, frame_rate)
        if stretches is not None:
            self.elapsed_s[[rows[-1] for rows in stretches]] = np.nan
            kept = np.isin(np.arange(len(recording)), np.concatenate(stretches))
            self.recording, self.elapsed_s = self.recording.keep(kept), self.elapsed_s[kept]
        driven_s = self.elapsed_s[~np.isnan(self.elapsed_s)]
        self.driven_s = float(driven_s.cumsum()[-1]) if len(driven_s) else 0.0
        if self.driven_s < SHORTEST_S:
            raise InputError(
                f"{names}: holds {self.driven_s:.1f} s of driving to replay; name a "
                f"recording of {SHORTEST_S:g} s or more, since each intervention counts as "
                f"{INTERVENTION_S:g} s"
            )
        self.frame_rate = len(driven_s) / self.driven_s
        self._speed_mps = self.recording.speed_mph * MPS_PER_MPH
        self._warp = cache(partial(Warp, self.rig))

    @property
    def name(self) -> str:
        """Return the name of the replay among tracks."""
        if self.stretches is None:
            return ", ".join(self.recording.names)
        folders = ", ".join(Path(folder).name or folder for folder in self.recording.names)
        return f"replay of {folders}"

    @property
    def words(self) -> str:
        """Return what is replayed, and with which rig, in words."""
        what = ", ".join(self.recording.names)
        if self.stretches is not None:
            what = f"{len(self.stretches)} held-out stretches of {what}"
        speed = f", at an assumed {self.speed_mph:g} mph" if self.speed_mph else ""
        guesses = f" (guessed: {', '.join(self.rig.guesses)})" if self.rig.guesses else ""
        metres = BELIEVABLE_M.get(self.rig.name)
        limit = "not measured" if metres is None else f"believable up to {metres:g} m"
        return (
            f"replay of {what}, {self.driven_s:.0f} s{speed}; rig: {self.rig.name}{guesses}; "
            f"warped frames: {limit}"
        )

    def reset(self, scenario: Scenario) -> State:
        """Begin at the first row."""
        margin_m = scenario.margin
        if margin_m is not None and not 0 < margin_m <= GREATEST_MARGIN_M:
            raise InputError(f"margin={margin_m:g}: must be above 0, up to {GREATEST_MARGIN_M:g} m")
        self.row, self.now_s, self.metres, self.car = 0, 0.0, 0.0, VirtualCar(self.rig)
        return self._state()

    def frame(self, camera: str = "center") -> np.ndarray:
        """Return the recorded frame, warped to the virtual car.

        Raises:
            InputError: an image cannot be read.
        """
        paths = dict(zip(CAMERAS, self.recording.images[self.row], strict=True))

        @cache
        def recorded(camera: str) -> np.ndarray:
            try:
                return read_image(paths[camera])
            except (OSError, ValueError) as error:
                image = f"{self.recording.place(self.row)}: {paths[camera]}"
                raise InputError(f"{image}: {error}; drivezoo edit leaves it out") from None

        cameras = [camera for camera, path in paths.items() if path and camera in self.rig.cameras]
        warp = self._warp(recorded("center").shape[:2])
        return warp(recorded, cameras, self.car.cte_m, self.car.heading_rad)

    def step(self, steering: float, throttle: float) -> State:
        """Steer the virtual car to the next row."""
        return self._advance(steering)

    def put_back(self, speed_mph: float) -> State:
        """Put the virtual car on the path, at the next row."""
        self.car = VirtualCar(self.rig)
        return self._advance(None)

    def facts(self, scenario: Scenario) -> dict[str, Any]:
        """Return the recording's name, the margin and the recorded driver's steering change."""
        change = float(np.abs(np.diff(self.recording.steering)).sum())
        return {
            "source": REPLAY,
            "track": self.name,
            "lane_m": min(MARGIN_M, self.rig.cameras["center"].up_m),
            "expert_steering_per_s": change / self.driven_s,
        }

    def expert_steering(self) -> float:
        """Return the steering of the recorded driver."""
        return float(self.recording.steering[min(self.row, len(self.recording) - 1)])

    def _advance(self, steering: float | None) -> State:
        """Drive to the next row; None leaves the virtual car on the path."""
        row, seconds = self.row, float(self.elapsed_s[self.row])
        self.row += 1
        if math.isnan(seconds):
            self.car = VirtualCar(self.rig)
            return self._state(moved=True)
        recorded = float(self.recording.steering[row])
        metres = float(self._speed_mps[row] + self._speed_mps[row + 1]) / 2 * seconds
        if steering is not None:
            self.car.step(steering, recorded, metres, max(1, math.ceil(seconds / STEP_S)))
        self.metres += metres
        self.now_s += seconds
        return self._state()

    def _state(self, moved: bool = False) -> State:
        recording, row = self.recording, min(self.row, len(self.recording) - 1)
        return State(
            time_s=self.now_s,
            speed_mph=float(recording.speed_mph[row]),
            throttle=float(recording.throttle[row] - recording.brake[row]),
            cross_track_m=self.car.cte_m,
            distance_m=self.metres,
            driven_m=self.metres,
            contact=self.car.lost,
            share=self.row / len(recording),
            moved=moved,
            done=self.row == len(recording),
        )


def with_speed(recording: Recording, speed_mph: float | None = None) -> Recording:
    """Return the recording, driven at a given speed where it holds none, or else in each row.

    Raises:
        InputError: `speed_mph` is None and a recording's speed is 0 in each row, as in a tub of a
            car without an odometer: nothing would be driven.
    """
    if speed_mph is not None:
        moves = np.isin(recording.recording, recording.recording[recording.speed_mph != 0])
        driven_mph = np.where(moves & ~moves.all(), recording.speed_mph, speed_mph)
        return replace(recording, speed_mph=driven_mph)
    if still := recording.without_speed:
        raise InputError(
            f"{still[0]}: its speed is 0 mph in each row, so that nothing would be driven; add "
            "speed=9 (score.replay_speed=9 in a training) if the car drove at 9 mph"
        )
    return recording


def seconds_of_rows(recording: Recording, frame_rate: float | None = None) -> np.ndarray:
    """Return the seconds from each row to the next, float64 [N]; NaN before a pause and at the end.

    Raises:
        InputError: the recording has no times, and `frame_rate` is None.
    """
    rows = len(recording)
    seconds = np.full(rows, np.nan)
    if frame_rate is None:
        unknown = np.flatnonzero(np.isnan(recording.time_s))
        if len(unknown):
            name = Path(str(recording.images[unknown[0], 0])).name
            raise InputError(
                f"{recording.place(unknown[0])}: {name} holds no time ({len(unknown)} of {rows} "
                "rows); add frame_rate=15 if the recording has 15 rows per second"
            )
        seconds[:-1] = np.diff(recording.time_s)
    elif not 1 <= frame_rate <= 100:
        raise InputError(f"frame_rate={frame_rate:g}: must be in 1..100")
    else:
        seconds[:-1] = 1 / frame_rate
        seconds[:-1][missing_rows(recording)] = np.nan  # such as those with bad images
    other = np.diff(recording.recording) != 0
    seconds[:-1][other | ~(seconds[:-1] > 0) | (seconds[:-1] > GAP_S)] = np.nan
    return seconds
