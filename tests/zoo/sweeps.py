"""Folders as runs leave them, without training any."""

import json
from pathlib import Path

from zoo.status import write_status


def write_run(
    folder: Path,
    autonomy: float | None = None,
    cte_m: float = 0.3,
    val_mse: float = 0.01,
    seed: int = 1,
    overrides: tuple[str, ...] = ("model=tiny",),
    tracks: tuple[str, ...] = ("lake",),
    **more: object,
) -> Path:
    """A finished run that drove so well on each of the tracks; None where it was not driven."""
    drive = None
    if autonomy is not None:
        figures = {
            "autonomy": [autonomy, 0.0],
            "cte_mean_m": [cte_m, 0.0],
            "interventions": [round(10 * (1 - autonomy)), 0.0],
        }
        drive = {
            "speed_mph": 20.0,
            "laps": 1.0,
            "seeds": 1,
            "tracks": dict.fromkeys(tracks, figures),
        }
    metrics = {
        "model": "tiny",
        "parameters": 41,
        "open_loop": {part: {"mse": val_mse} for part in ("train", "val", "test")},
        "drive": drive,
        "seed": seed,
        "wall_s": 12.0,
        **more,
    }
    (folder / ".hydra").mkdir(parents=True)
    (folder / "metrics.json").write_text(json.dumps(metrics))
    settings = dict(one.split("=") for one in overrides)
    (folder / ".hydra" / "config.yaml").write_text(json.dumps({"seed": seed, **settings}))
    (folder / ".hydra" / "overrides.yaml").write_text(json.dumps([*overrides, f"seed={seed}"]))
    choices = {"hydra": {"runtime": {"choices": {"experiment": None}, "cwd": str(folder)}}}
    (folder / ".hydra" / "hydra.yaml").write_text(json.dumps(choices))
    (folder / "metrics.csv").write_text(
        f"epoch,train/loss,val/mse\n0,0.2,\n0,,{2 * val_mse}\n1,0.1,\n1,,{val_mse}\n"
    )
    write_status(folder, "finished")
    return folder


def change_status(folder: Path, **fields: object) -> None:
    """Write other fields into a `status.json`."""
    path = folder / "status.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | fields))
