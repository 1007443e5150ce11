"""Measurements of replays: how they rank networks, and how far a warped frame is believable."""

import math
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np

from benchmarks.material import frames_of
from benchmarks.measuring import print_table
from datamodules.driving_log import CAMERAS
from datamodules.recording_format import read_recordings
from zoo.base.rig import UDACITY, single_camera_rig
from zoo.base.rig_file import write_rig
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.driving.camera_warp import Warp
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.simulator.recorder import Recorder
from zoo.simulator.simulated_world import Start, open_world


def replays(
    folder: str,
    *checkpoints: str,
    world: str = "embedded",
    track: str = "lake",
    frame_rate: str = "nan",
    laps: str = "1",
) -> None:
    """Compare replays with drives: `replays RECORDING CKPT... [world=donkey track=...]`.

    RECORDING is of `laps` of the track, with `frame_rate` rows a second if the names of its images
    do not tell. Each checkpoint is replayed on it, and drives the same laps at the replay's speed;
    an intervention is at 1 m in both. Rank correlations (Spearman) show whether the replays, and
    the mean squared errors on the same rows, order the checkpoints as drives do. Their 95 %
    intervals are bootstraps over the checkpoints.
    """
    from benchmarks.rank_correlations import rank_correlation
    from zoo.driving.metrics import measure
    from zoo.driving.replay_world import ReplayWorld

    recording, rate = read_recordings(folder), float(frame_rate)
    frames, speeds, true = frames_of(folder, len(recording))
    speed = float(np.median(speeds).round(1))
    same = Scenario(track, world=world, laps=float(laps), speed=speed, margin=1.0)
    rows = []
    for checkpoint in map(find_checkpoint, checkpoints):
        policy = load_policy(checkpoint)
        replay = ReplayWorld(recording, None if np.isnan(rate) else rate)
        drives = all_drives(policy, [Scenario(margin=1.0)], world=replay)
        drives += all_drives(policy, [same])
        steering = [policy(*pair)[0] for pair in zip(frames, speeds, strict=True)]
        mse = np.mean((np.array(steering) - true) ** 2)
        found = [[measure(one)[key] for key in ("interventions", "cte_mean_m")] for one in drives]
        rows.append([mse, *np.ravel(found)])
        print(checkpoint, *(f"{number:.4g}" for number in rows[-1]), flush=True)
    mse, replayed, replayed_m, driven, driven_m = np.transpose(rows)
    names = f"interventions of {len(rows)} drives", "their mean error, m"
    ordered = {"interventions of replays": replayed, "mean error, m": replayed_m, "MSE": mse}
    lines = [
        [
            name,
            *(
                "{:+.2f} ({:+.2f} to {:+.2f})".format(*rank_correlation(offline, drives))
                for offline in ordered.values()
            ),
        ]
        for name, drives in zip(names, (driven, driven_m), strict=True)
    ]
    print_table(["rank correlation (95 %)", *ordered], lines)


def middle(folder: str, track: str, laps: str = "1") -> None:
    """Record a drive along the middle of a Donkeycar simulator's road: `middle FOLDER SCENE`.

    The driver steers by the simulator's cross-track error, and holds 15 mph. `drivezoo simulator
    serve` must run; FOLDER gets the rig of its usual camera.
    """
    from zoo.driving.donkey_world import DonkeyWorld
    from zoo.simulator.donkey_session import CAMERA, STEERING_DEG

    scenario = Scenario(track, world="donkey", laps=float(laps))
    with closing(DonkeyWorld(track)) as world, Recorder(folder, relative=True) as recorder:
        state, right_m, past_s = world.reset(scenario), 0.0, -math.inf
        while not state.done:
            change = ((state.cross_track_m or 0.0) - right_m) / (state.time_s - past_s)
            right_m, past_s = state.cross_track_m or 0.0, state.time_s
            steering = min(max(-1.4 * right_m - 0.9 * change, -1.0), 1.0)
            throttle = float(state.speed_mph < scenario.speed)
            frames = {"center": world.frame()}
            recorder.add(frames, steering, throttle, 0.0, state.speed_mph, past_s)
            state = world.step(steering, throttle)
    car = "Donkeycar simulator", CAMERA, UDACITY.wheelbase_m, STEERING_DEG
    write_rig(Path(folder), single_camera_rig(*car))


def warp(folder: str | None = None) -> None:
    """Compare warped with real frames of a car that is displaced: `warp [RECORDING]`.

    In the embedded world the car is displaced; a recording has side cameras. Over 40 places: the
    correlation of the grey levels of the ground, which the own car does not hide, and the mean
    difference of the steering that two networks give for a frame and the real frame, each without
    and with the warp.
    """
    networks = [load_policy(find_checkpoint(name)) for name in ("lenet", "pilotnet")]
    rows = []
    for metres, pairs in _displaced(folder):
        figures = []
        for real, plain, warped in pairs:
            ground = [
                cv2.cvtColor(one, cv2.COLOR_RGB2GRAY)[65:130] for one in (real, plain, warped)
            ]
            small = [
                cv2.resize(one, (80, 16), interpolation=cv2.INTER_AREA).ravel() for one in ground
            ]
            figures.append([np.corrcoef(small[0], one)[0, 1] for one in small[1:]])
            for network in networks:
                true, *others = (network(one, 15.0)[0] for one in (real, plain, warped))
                figures[-1] += [abs(other - true) for other in others]
        rows.append([metres, *(f"{one:.2f}" for one in np.mean(figures, axis=0))])
    head = ["moved, m", "correlation, not warped", "warped", "LeNet's error, not warped", "warped"]
    print_table([*head, "PilotNet's, not warped", "warped"], rows)


def _displaced(folder: str | None) -> Iterator[tuple[str, list[tuple[np.ndarray, ...]]]]:
    """Yield displacements, each with pairs of a real, an unwarped and a warped frame."""
    mover = Warp(UDACITY, (160, 320))
    if folder is None:
        world = open_world("lake", "auto")
        for metres in (-2.0, -1.5, -1.0, -0.5, -0.2, 0.2, 0.5, 1.0, 1.5, 2.0):
            pairs = []
            for place in np.linspace(0, 0.97 * world.track.length, 40):
                frames = []
                for cte in (metres, 0.0):
                    world.put_back(Start(float(place), cte))
                    frames.append(world.frame())
                plain = frames[1]
                pairs.append(
                    (*frames, mover({"center": plain}.__getitem__, ["center"], metres, 0.0))
                )
            yield f"{metres:+.1f}", pairs
        return
    recording = read_recordings(folder)
    chosen = np.linspace(0, len(recording) - 1, 40).astype(int).tolist()
    for source, target in (
        ("center", "left"),
        ("center", "right"),
        ("left", "center"),
        ("right", "center"),
    ):
        pairs = []
        for row in chosen:
            frames = {name: recording.image(row, CAMERAS.index(name)) for name in CAMERAS}
            moved = UDACITY.cameras[target].right_m or 1e-6  # 0 is the recorded frame itself
            warped = mover(frames.__getitem__, [source], moved, 0.0)
            pairs.append((frames[target], frames[source], warped))
        moved = UDACITY.cameras[target].right_m - UDACITY.cameras[source].right_m
        yield f"{source} to {target}, {moved:+.2f}", pairs
