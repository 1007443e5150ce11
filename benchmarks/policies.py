"""Measurements of policies: `python benchmarks/policies.py NAME ...`, one function each."""

import time
from pathlib import Path

import numpy as np
import torch
from scipy.stats import spearmanr

from benchmarks.measuring import print_table, run_named
from datamodules.image import read_image
from datamodules.recording_format import read_recordings
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.policy import load_policy
from zoo.worlds.run_drives import all_drives
from zoo.worlds.scenario import Scenario


def frames_of(folder: str, count: int) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Return centre frames spread over a recording, their speeds in mph and their steering."""
    recording = read_recordings(folder)
    rows = np.linspace(0, len(recording) - 1, min(count, len(recording))).astype(int)
    frames = [read_image(Path(path)) for path in recording.images[rows, 0]]
    return frames, recording.speed_mph[rows], recording.steering[rows]


def doubt(folder: str, *checkpoints: str) -> None:
    """Compare spread and error of policies: `doubt RECORDING CKPT...`.

    Over 300 frames of the centre camera: the mean absolute error of the steering, the mean spread,
    the share of frames whose recorded steering lies within 1.96 spreads of the mean (0.95 for a
    perfect spread), the rank correlation of spread and absolute error, and the CPU time of a frame
    on one thread.
    """
    torch.set_num_threads(1)
    frames, speeds, steering = frames_of(folder, 300)
    rows = []
    for checkpoint in checkpoints:
        policy = load_policy(find_checkpoint(checkpoint))
        for frame in frames[:5]:  # warms up
            policy(frame, 9.0)
        began = time.process_time()
        answers = [policy(*pair) for pair in zip(frames, map(float, speeds), strict=True)]
        took_ms = 1000 * (time.process_time() - began) / len(frames)
        spread = np.array([answer.spread for answer in answers], float)
        error = np.abs([answer.steering for answer in answers] - steering)
        means = [f"{error.mean():.3f}", f"{spread.mean():.3f}"]
        means.append(f"{(error <= 1.96 * spread).mean():.2f}")
        rows.append([policy.name, *means, f"{spearmanr(spread, error)[0]:.2f}", f"{took_ms:.1f}"])
    print_table(["policy", "error", "spread", "within", "correlation", "CPU ms"], rows)


def replays(folder: str, *checkpoints: str) -> None:
    """Compare replays with drives: `replays RECORDING CKPT...`.

    RECORDING is of the embedded lake (`drivezoo simulator record track=lake laps=1 out=FOLDER`).
    Each checkpoint is replayed on it, and drives a lap of the lake twice: with the replay's speed
    and interventions at 1 m, and with the settings of `drivezoo evaluate`. Rank correlations
    (Spearman) show whether the interventions of replays, and the mean squared errors on the same
    rows, order the checkpoints as drives do.
    """
    from zoo.drives.metrics import measure
    from zoo.worlds.replay_world import ReplayWorld

    recording = read_recordings(folder)
    frames, speeds, true = frames_of(folder, len(recording))
    same = Scenario("lake", speed=float(np.median(speeds)), margin=1.0)
    rows = []
    for checkpoint in map(find_checkpoint, checkpoints):
        policy = load_policy(checkpoint)
        drives = all_drives(policy, [Scenario()], world=ReplayWorld(recording))
        drives += all_drives(str(checkpoint), [same, Scenario("lake")])
        steering = [policy(*pair)[0] for pair in zip(frames, speeds, strict=True)]
        mse = np.mean((np.array(steering) - true) ** 2)
        rows.append([mse, *(measure(drive)["interventions"] for drive in drives)])
        print(checkpoint, *rows[-1], flush=True)
    mse, replayed, *driven = np.transpose(rows)
    lines = [
        [name, *(f"{spearmanr(offline, drives).statistic:+.2f}" for offline in (replayed, mse))]
        for name, drives in zip(("same speed and margin", "evaluate"), driven, strict=True)
    ]
    print_table(["rank correlation with drives", "interventions of replays", "MSE"], lines)


if __name__ == "__main__":
    run_named(doubt, replays)
