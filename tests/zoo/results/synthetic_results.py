"""Results of the benchmark with figures drawn from known distributions."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from zoo.results.result import DriveRecord, digest_of_drives
from zoo.results.summary import summarize_drives

ROADS = (
    *[("like", f"lakeside:{501 + number}", {}) for number in range(12)],
    *[("sharp", f"alpine:{701 + number}", {}) for number in range(12)],
    *[("dynamics", f"lakeside:{501 + number}", {"delay_s": 0.2}) for number in range(4)],
    *[("laps", name, {}) for name in ("udacity_lake", "udacity_jungle")],
)


LENET = {"model": "LeNet", "parameters": 1000, "data": "f00d"}


def figures(
    rng: np.random.Generator, mean: float, seeds: int, by_seed: float, roads: np.ndarray
) -> np.ndarray:
    """Return autonomy [seeds, roads] around a mean: roads are of all entries, seeds of one."""
    noise = 0.02 * rng.normal(size=(seeds, len(roads)))
    return mean + by_seed * rng.normal(size=(seeds, 1)) + roads + noise


def result(autonomy: np.ndarray, entry: str = "lenet", roads: Sequence = ROADS) -> dict:
    """Return a result as plain containers; the cross-track error falls as the autonomy rises."""
    content = {
        "version": 1,
        "analysis": 2,
        "suite": "own",
        "roads": "0123456789abcdef",
        "code": {"hash": "a1", "commit": None},
        "entry": entry,
        "checkpoints": [
            {"file": f"{seed}.ckpt", "sha256": f"{seed:064x}", "training_seed": seed} | LENET
            for seed in range(len(autonomy))
        ],
        "drives": [
            {
                "checkpoint": seed,
                "group": group,
                "track": track,
                "settings": settings,
                "figures": {
                    "autonomy": float(autonomy[seed, road]),
                    "cte_mean_m": float(2 - autonomy[seed, road]),
                    "interventions": float(7.5 * (1 - autonomy[seed, road])),
                    "driven_m": 300.0,
                    "driven_s": 45.0,
                    "steering_per_s": 0.5,
                },
                "digest": "0" * 16,
            }
            for seed in range(len(autonomy))
            for road, (group, track, settings) in enumerate(roads)
        ],
        "groups": {},
        "usual": {"speed": 15.0},
    }
    return summed(content)


def of_levels(autonomy: np.ndarray, entry: str, roads: Sequence) -> dict:
    """Return a result of roads whose names have their level, such as `bends_1:17`."""
    content = result(autonomy, entry, roads)
    for drive in content["drives"]:
        drive["level"] = int(drive["track"][6])
        drive["figures"]["cte_max_m"] = 1.0
    return summed(content)


def summed(content: dict) -> dict:
    """Return a result with the figures and the digest of its drives."""
    drives = [DriveRecord(**drive) for drive in content["drives"]]
    sums = {name: _plain(value) for name, value in vars(summarize_drives(drives)).items()}
    return content | sums | {"digest": digest_of_drives(drives)}


def _plain(figures: object) -> object:
    if isinstance(figures, dict):
        return {name: _plain(value) for name, value in figures.items()}
    return figures.model_dump()


def write(folder: Path, content: dict) -> Path:
    """Write a result into a folder and return the folder."""
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(json.dumps(content))
    return folder
