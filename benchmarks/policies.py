"""Measurements of policies: `python benchmarks/policies.py NAME ...`, one function each."""

import hashlib
import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import repeat
from pathlib import Path

import cv2
import numpy as np
import torch
from scipy.stats import spearmanr

from benchmarks.marked_page import markdown_table
from benchmarks.measuring import make_console, print_table, run_named
from benchmarks.study_grid import kept
from datamodules.image import read_image
from datamodules.recording import read_recordings
from datamodules.view import View
from simulator.rig import CAMERAS
from simulator.weather import CLEAR
from simulator.world import Start, open_world
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.policy import CheckpointPolicy, load_policy
from zoo.worlds.run_drives import all_drives
from zoo.worlds.scenario import Scenario

REPLAYS = Path("outputs/replay_validation")


def frames_of(
    folder: str, count: int, edges: bool = True
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Return centre frames spread over a recording, their speeds in mph and their steering.

    Args:
        folder: folder of the recording.
        count: number of frames.
        edges: whether the first and the last row are among them.
    """
    recording = read_recordings(folder)
    rows = np.linspace(0, len(recording) - 1, count + 2 * (not edges)).astype(int)
    rows = rows if edges else rows[1:-1]
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


def saliency(checkpoint: str, folder: str) -> None:
    """Compare saliency with greyed-out patches: `saliency CKPT RECORDING`.

    In each of 11 frames, patches of 20 x 20 pixels, 10 pixels apart, get their mean colour one by
    one, and change the steering. It prints the mean rank correlation between these changes and the
    saliency at the same places, within the network's view.
    """
    from zoo.saliency.visual_backprop import Saliency

    policy, step = load_policy(find_checkpoint(checkpoint)), 10
    frames, *_ = frames_of(folder, 11, edges=False)
    truth = [steering_changes(policy, frame, step) for frame in frames]
    top, bottom = policy.view.crop
    seen = np.s_[-(-top // step) : (160 - bottom) // step]
    for name, published in (("gradient-weighted", False), ("as published", True)):
        saliency_of, ranks = Saliency(policy, published), []
        for frame, changes in zip(frames, truth, strict=True):
            size = changes.shape[::-1]
            where = cv2.resize(saliency_of(frame, 9.0), size, interpolation=cv2.INTER_AREA)
            ranks.append(spearmanr(where[seen].ravel(), changes[seen].ravel())[0])
        print(f"{name}: {np.mean(ranks):.2f} (over {len(ranks)} frames, sd {np.std(ranks):.2f})")


def steering_changes(policy: CheckpointPolicy, frame: np.ndarray, step: int) -> np.ndarray:
    """Return float64 [16, 32]: the change of steering when the patch at a place is grey."""
    steering = policy(frame, 9.0)[0]
    changes = np.zeros((frame.shape[0] // step, frame.shape[1] // step))
    for row, column in np.ndindex(*changes.shape):
        top, left = row * step - step // 2, column * step - step // 2
        patch = np.s_[max(top, 0) : top + 2 * step, max(left, 0) : left + 2 * step]
        greyed = frame.copy()
        greyed[patch] = frame[patch].mean((0, 1))
        changes[row, column] = abs(policy(greyed, 9.0)[0] - steering)
    return changes


def guard(checkpoint: str, samples: str = "16") -> None:
    """Measure frames per second with a guard: `guard CKPT [samples]`.

    For each score that the checkpoint can have: the medians of 200 frames, in turns, in one thread:
    milliseconds of processor time of the policy alone and with the guard, and frames per second
    with the guard. Processor time is close to wall time on an idle machine.
    """
    from zoo.monitor.guard_file import Guard
    from zoo.monitor.guarded_policy import GuardedPolicy
    from zoo.monitor.scores import METHODS, fit_score
    from zoo.monitor.signals import ENSEMBLE, IMAGE_SIZE, MAP_SIZE

    torch.set_num_threads(1)
    shapes = {"image": (*IMAGE_SIZE[::-1], 3), "map": (*MAP_SIZE[::-1], 1)}
    policy, rng = load_policy(find_checkpoint(checkpoint)), np.random.default_rng(0)
    for name, method in METHODS.items():
        if method.signal == ENSEMBLE:
            continue
        nominal = rng.integers(0, 255, (64, *shapes.get(method.signal, ())), np.uint8)
        fitted = Guard(fit_score(name, nominal, epochs=1), 1e9, 15, 6.0, int(samples), "")
        try:
            guarded = GuardedPolicy(policy, fitted)
        except InputError as error:
            print(f"{name}: {error}")
            continue
        took: dict[CheckpointPolicy | GuardedPolicy, list[float]] = {policy: [], guarded: []}
        for frame in rng.integers(0, 255, (210, 160, 320, 3), np.uint8):
            for driver, times in took.items():
                began = time.process_time()
                driver(frame, 9.0)
                times.append(1000 * (time.process_time() - began))
        alone, both = (float(np.median(times[10:])) for times in took.values())  # after warming up
        print(f"{name}: {alone:.1f} ms alone, {both:.1f} ms with it: {1000 / both:.0f} frames/s")


def start_seeds(tracks: str, *checkpoints: str) -> None:
    """Measure whether start seeds fail in other places: `start_seeds TRACKS CKPT...`.

    Drives a lap of each track from three starts, in clear weather and in weather that the seed
    draws. Prints the interventions of each seed, and the share of them that the next seed repeats
    within 5 m of the same place: 1 shows copies of one observation, not three of them.
    """
    for name in checkpoints:
        for track in tracks.split(","):
            for weather in (CLEAR, "random"):
                scenarios = [Scenario(track, seed, weather=weather) for seed in range(3)]
                drives = all_drives(str(find_checkpoint(name)), scenarios)
                places = [drive.distance_m[drive.intervention] for drive in drives]
                again, length_m = 0, drives[0].length_m
                for own, other in zip(places, [places[-1], *places], strict=False):
                    apart = np.abs(own[:, None] - other[None])
                    apart = np.minimum(apart, length_m - apart).min(axis=1, initial=np.inf)
                    again += int((apart <= 5.0).sum())
                counts = [len(own) for own in places]
                share = f"{again / sum(counts):.2f}" if sum(counts) else "-"
                kind = "random" if weather == "random" else "clear"
                print(name, track, kind, *counts, f"repeated: {share}", flush=True)


def inputs(folder: str, *checkpoints: str) -> None:
    """Find what networks were trained to see, as `drivezoo import`: `inputs RECORDING CKPT...`.

    Each network is tried with its weights and with random ones.
    """
    from zoo.input_search.combinations import SCALES, KnownInput, read_trial_frames
    from zoo.input_search.judgement import judge
    from zoo.input_search.trials import try_inputs

    def keys(view: View) -> str:
        return f"`{view.colour}` {view.crop[0]},{view.crop[1]}"

    frames, rows = read_trial_frames(read_recordings(folder), 300), []
    for path in checkpoints:
        checkpoint = load_checkpoint(path)
        scale = tuple(checkpoint.config["model"].get("scale", SCALES[0]))
        for name in (keys(checkpoint.view), "untrained"):
            if name == "untrained":
                for module in checkpoint.network.modules():
                    if hasattr(module, "reset_parameters"):
                        module.reset_parameters()
            known = KnownInput(shape=checkpoint.view.shape, scale=scale)
            trials = try_inputs(lambda view, scale, of=checkpoint: of.network, known, frames)
            judged = judge(trials)
            best, view = judged.best, judged.best.combination.view
            crop, colour = "-", "-"
            for trial in reversed([one for one in trials.finalists if one is not best]):
                other = trial.combination.view
                cell = f"{keys(other)}: {trial.score:.3f}"
                if other.colour != view.colour:
                    colour = cell
                elif other.crop != view.crop and other == replace(
                    view, crop=other.crop, resize=other.resize
                ):
                    crop = cell
            recovery = "-" if best.recovery is None else f"{best.recovery:+.3f}"
            cells = [name, keys(view), f"{best.score:.3f}", f"{best.correlation:.3f}", recovery]
            rows.append([*cells, crop, colour, "no" if judged.doubts else "yes"])
    head = ["trained with", "found", "agreement", "correlation", "recovery", "next crop"]
    print(markdown_table([*head, "next colour", "convincing"], rows, left=8))


def replays(folder: str, *checkpoints: str) -> None:
    """Compare replays with drives: `replays RECORDING CKPT...`.

    RECORDING is of the embedded lake (`drivezoo simulator record track=lake laps=1 out=FOLDER`).
    First, recorded frames warped to a displaced or turned car are compared with frames rendered
    there. Then each checkpoint is replayed on the recording, and drives a lap of the lake twice:
    with the replay's speed and interventions at 1 m, and with the settings of `drivezoo evaluate`.
    Rank correlations (Spearman) show whether replays order the checkpoints as drives do, and
    whether the mean squared error on the same rows does. Figures are kept in
    outputs/replay_validation.
    """
    compare_warps()
    # Without this, a network whose last epoch was the best would count twice.
    by_digest = {digest(path): path for path in reversed(checkpoints)}
    names = list(by_digest.values())[::-1]
    workers = int(os.environ.get("WORKERS", max(1, (os.cpu_count() or 2) - 1)))
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        all_figures = pool.map(drive_and_replay, names, repeat(folder))
        found = dict(zip(names, all_figures, strict=True))
    order = sorted(
        names,
        key=lambda name: (-found[name]["replay"]["autonomy"], found[name]["replay"]["cte_rms_m"]),
    )
    rows = []
    for name in order:
        cells = [name, f"{found[name]['replay']['mse']:.4f}"]
        for kind in ("replay", "same", "evaluate"):
            figures = found[name][kind]
            cells.append(f"{figures['autonomy']:.1%} ({figures['interventions']})")
            cells.append(f"{figures['cte_mean_m']:.2f}")
        rows.append(cells)
    print_table(["checkpoint", "MSE", "replay", "cte", "same", "cte", "evaluate", "cte"], rows)
    keys = ("autonomy", "interventions", "cte_mean_m", "cte_rms_m")
    pairs = [*zip(keys, keys, strict=True), ("mse", "interventions")]
    rows = []
    for kind in ("same", "evaluate"):
        cells = [f"replay with {kind}, {len(order)} checkpoints"]
        for offline, driven in pairs:
            replayed = [found[name]["replay"][offline] for name in order]
            value = spearmanr(replayed, [found[name][kind][driven] for name in order]).statistic
            cells.append(f"{value:+.2f}")
        rows.append(cells)
    print_table(["Spearman's rank correlation", *keys, "MSE with interventions"], rows)


def digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]


def drive_and_replay(checkpoint: str, folder: str) -> dict[str, dict[str, float]]:
    """Return a checkpoint's figures: `replay`, `same` (speed and margin), `evaluate`."""
    from zoo.drives.metrics import measure
    from zoo.worlds.replay_world import ReplayWorld

    def figures() -> dict[str, dict[str, float]]:
        torch.set_num_threads(1)
        recording, policy = read_recordings(folder), load_policy(checkpoint)
        (replay,) = all_drives(policy, [Scenario()], world=ReplayWorld(recording))
        replayed = measure(replay)
        frames, speeds, true = frames_of(folder, len(recording))
        steering = [policy(*pair)[0] for pair in zip(frames, speeds, strict=True)]
        replayed["mse"] = float(np.mean((np.array(steering) - true) ** 2))
        same = Scenario("lake", speed=float(np.median(speeds)), margin=1.0)
        drives = all_drives(checkpoint, [same, Scenario("lake")])
        return {"replay": replayed, "same": measure(drives[0]), "evaluate": measure(drives[1])}

    return kept(REPLAYS / f"{digest(checkpoint)}-{Path(folder).name}.json", figures)


def compare_warps() -> None:
    """Print the warp's mean absolute error below the horizon, in grey levels of 255."""
    from zoo.worlds.camera_warp import Warp

    world, warp = open_world("lake"), Warp()
    rows, strips = [], []
    poses = ((0.0, 3.0), (0.0, -6.0), (0.25, 0.0), (0.5, 0.0), (0.5, 3.0), (-0.9, -5.0))
    for right_m, heading_deg in (*poses, (0.4, -8.0)):
        differences = []
        for place in np.arange(20, 1130, 55.0):
            world.put_back(Start(place))
            frames = {camera: world.frame(camera) for camera in CAMERAS}
            car, heading = world.car, world.car.heading
            right = np.array([np.sin(heading), -np.cos(heading)]) * right_m
            car.place(car.x + right[0], car.y + right[1], heading - np.radians(heading_deg))
            truth = world.frame().astype(int)
            warped = warp(frames.__getitem__, list(CAMERAS), right_m, np.radians(heading_deg))
            errors = [np.abs(image - truth) for image in (frames["center"], warped)]
            differences.append([*(error[55:].mean() for error in errors), errors[1].mean()])
            if len(differences) == 4:
                strips.append(np.hstack([frames["center"], warped, truth.astype(np.uint8)]))
        still, moved, whole = np.mean(differences, 0)
        cells = [f"{moved:.1f}", f"{still:.1f}", f"{moved / still:.0%}", f"{whole:.1f}"]
        rows.append([f"{right_m:+.2f}", f"{heading_deg:+.0f}", *cells])
    head = ["right, m", "turned, deg", "warped", "not warped", "share", "warped, all rows"]
    print_table(head, rows)
    REPLAYS.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(REPLAYS / "warps.png"), np.vstack(strips)[..., ::-1])
    make_console().print(f"{REPLAYS / 'warps.png'} (recorded, warped, true)")


if __name__ == "__main__":
    run_named(doubt, guard, inputs, replays, saliency, start_seeds)
