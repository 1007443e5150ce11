"""Do start seeds fail in other places? `python benchmarks/start_seeds.py TRACKS CKPT...`.

Drives a lap of each track from three starts, in clear weather and in weather that the seed draws.
Prints the interventions of each seed, and the share of them that the next seed repeats within 5 m
of the same place: 1 shows copies of one observation, not three of them.
"""

import sys

import numpy as np
import torch

from simulator.weather import CLEAR
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.policy import load_policy
from zoo.evaluate.many_drives import Setup, drive_setup, open_setup

SEEDS, NEAR_M = 3, 5.0


def failures(checkpoint: str, setup: Setup) -> tuple[np.ndarray, float]:
    """Return the places of the interventions in metres, float64 [N], and the track's length."""
    world = open_setup(setup, "auto")
    drive = drive_setup(load_policy(checkpoint), world, setup)
    world.pictures.close()
    return drive.distance_m[drive.intervention], drive.length_m


def repeated(first: np.ndarray, second: np.ndarray, length_m: float) -> float:
    """Return the number of places of a closed track that have a place of `second` nearby."""
    apart = np.abs(first[:, None] - second[None])
    return float((np.minimum(apart, length_m - apart).min(axis=1, initial=np.inf) <= NEAR_M).sum())


def main(tracks: str, checkpoints: list[str]) -> None:
    torch.set_num_threads(1)
    for name in checkpoints:
        checkpoint = str(find_checkpoint(name))
        for track in tracks.split(","):
            for weather in (CLEAR, "random"):
                setups = [Setup(track, seed, weather=weather) for seed in range(SEEDS)]
                drives = [failures(checkpoint, one) for one in setups]
                counts = [len(places) for places, _ in drives]
                again = sum(
                    repeated(places, drives[seed - 1][0], length_m)
                    for seed, (places, length_m) in enumerate(drives)
                )
                share = f"{again / sum(counts):.2f}" if sum(counts) else "-"
                kind = "random" if weather == "random" else "clear"
                print(name, track, kind, *counts, f"repeated: {share}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
