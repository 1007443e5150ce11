"""Compare replays with drives: `python benchmarks/replay_validation.py RECORDING CKPT...`.

RECORDING is of the embedded lake (`drivezoo simulator record track=lake laps=1 out=FOLDER`).
First, recorded frames warped to a displaced or turned car are compared with frames rendered there.
Then every checkpoint is replayed on the recording, and drives a lap of the lake twice: with the
replay's speed and interventions at 1 m, and with the settings of `drivezoo evaluate CKPT`.
Rank correlations (Spearman) show whether replays order the checkpoints as drives do, and whether
the mean squared error on the same rows does. Drives are kept in outputs/replay_validation.
"""

import hashlib
import json
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import spearmanr

from datamodules.image import decode_image
from datamodules.recording import Recording, read_recordings
from simulator.rig import CAMERAS
from simulator.world import Start, open_world
from zoo.checkpoints.policy import Policy, load_policy
from zoo.evaluate.camera_warp import Warp
from zoo.evaluate.recording_replay import replay

OUT = Path("outputs/replay_validation")
POSES = ((0.0, 3.0), (0.0, -6.0), (0.25, 0.0), (0.5, 0.0), (0.5, 3.0), (-0.9, -5.0), (0.4, -8.0))
PLACES = np.arange(20, 1130, 55.0)
HORIZON_ROW = 55
FIGURES = ("autonomy", "interventions", "cte_mean_m", "cte_rms_m")


def compare_warps(console: Console) -> None:
    """Print the warp's mean absolute error below the horizon, in grey levels of 255."""
    world, warp = open_world("lake"), Warp()
    table = Table("right, m", "turned, deg", "warped", "not warped", "share", "warped, all rows")
    strips = []
    for right_m, heading_deg in POSES:
        differences = []
        for place in PLACES:
            world.put_back(Start(place))
            frames = {camera: world.frame(camera) for camera in CAMERAS}
            car, heading = world.car, world.car.heading
            right = np.array([np.sin(heading), -np.cos(heading)]) * right_m
            car.place(car.x + right[0], car.y + right[1], heading - np.radians(heading_deg))
            truth = world.frame().astype(int)
            warped = warp(frames.__getitem__, list(CAMERAS), right_m, np.radians(heading_deg))
            images = (frames["center"], warped)
            road = [np.abs(one - truth)[HORIZON_ROW:].mean() for one in images]
            differences.append([*road, np.abs(warped - truth).mean()])
            if place == PLACES[3]:
                strips.append(np.hstack([frames["center"], warped, truth.astype(np.uint8)]))
        still, moved, all_rows = np.mean(differences, 0)
        cells = (f"{moved:.1f}", f"{still:.1f}", f"{moved / still:.0%}", f"{all_rows:.1f}")
        table.add_row(f"{right_m:+.2f}", f"{heading_deg:+.0f}", *cells)
    console.print(table)
    sheet = OUT / "warps.png"
    cv2.imwrite(str(sheet), np.vstack(strips)[..., ::-1])
    console.print(f"{sheet} (recorded, warped, true)")


def drive_and_replay(checkpoint: str, recording_folder: str) -> dict[str, dict[str, float]]:
    """Return a checkpoint's figures: `replay`, `same` (speed and margin), `evaluate`."""
    import torch

    from zoo.drives.metrics import measure
    from zoo.drives.speed_controller import PI
    from zoo.evaluate.embedded_drive import drive_closed_loop

    torch.set_num_threads(1)
    recording, policy = read_recordings(recording_folder), load_policy(checkpoint)
    found = {"replay": measure(replay(policy, recording))}
    found["replay"]["mse"] = mean_squared_error(policy, recording)
    speed_mph = float(np.median(recording.speed_mph))
    for name, mph, margin_m in (("same", speed_mph, 1.0), ("evaluate", 15.0, None)):
        kept = OUT / f"{digest(checkpoint)}-{name}-{mph:.1f}.json"
        if not kept.exists():
            world = open_world("lake")
            pedal = PI(mph, kp=0.1, ki=0.002)
            drive = drive_closed_loop(policy, world, pedal, 0, 1.0, margin_m=margin_m)
            kept.write_text(json.dumps(measure(drive)))
        found[name] = json.loads(kept.read_text())
    return found


def digest(checkpoint: str) -> str:
    return hashlib.sha256(Path(checkpoint).read_bytes()).hexdigest()[:16]


def mean_squared_error(policy: Policy, recording: Recording) -> float:
    """Return the steering's mean squared error on the recorded centre frames."""
    frames = (decode_image(Path(path).read_bytes()) for path in recording.images[:, 0])
    steering = [policy(*pair)[0] for pair in zip(frames, recording.speed_mph, strict=True)]
    return float(np.mean((np.array(steering) - recording.steering) ** 2))


def print_table(console: Console, found: dict[str, dict]) -> None:
    """Print a row for each checkpoint, best replay first, then the correlations."""
    order = sorted(
        found,
        key=lambda one: (-found[one]["replay"]["autonomy"], found[one]["replay"]["cte_rms_m"]),
    )
    table = Table("checkpoint", "MSE", "replay", "cte", "same", "cte", "evaluate", "cte")
    for checkpoint in order:
        cells = [f"{found[checkpoint]['replay']['mse']:.4f}"]
        for one in ("replay", "same", "evaluate"):
            figures = found[checkpoint][one]
            cells.append(f"{figures['autonomy']:.1%} ({figures['interventions']})")
            cells.append(f"{figures['cte_mean_m']:.2f}")
        table.add_row(checkpoint, *cells)
    console.print(table)
    correlations = Table("Spearman's rank correlation", *FIGURES, "MSE with interventions")
    for one in ("same", "evaluate"):
        pairs = [(key, key) for key in FIGURES] + [("mse", "interventions")]
        values = [
            spearmanr(
                [found[checkpoint]["replay"][offline] for checkpoint in order],
                [found[checkpoint][one][driven] for checkpoint in order],
            ).statistic
            for offline, driven in pairs
        ]
        name = f"replay with {one}, {len(order)} checkpoints"
        correlations.add_row(name, *(f"{value:+.2f}" for value in values))
    console.print(correlations)


def main(recording: str, checkpoints: list[str]) -> None:
    """Print the tables; write the images and `figures-NAME.json`."""
    OUT.mkdir(parents=True, exist_ok=True)
    console = Console(width=160)
    # Without this, a network whose last epoch was the best would count twice.
    checkpoints = list({digest(one): one for one in reversed(checkpoints)}.values())[::-1]
    compare_warps(console)
    workers = int(os.environ.get("WORKERS", max(1, (os.cpu_count() or 2) - 1)))
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        all_figures = pool.map(drive_and_replay, checkpoints, [recording] * len(checkpoints))
        found = dict(zip(checkpoints, all_figures, strict=True))
    (OUT / f"figures-{Path(recording).name}.json").write_text(json.dumps(found, indent=1) + "\n")
    print_table(console, found)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
