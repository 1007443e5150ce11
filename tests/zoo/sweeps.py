"""Run folders for tests, written without training."""

import json
from pathlib import Path

from zoo.runs.status import read_status, write_status


def status(folder: Path) -> str:
    return read_status(folder).get("status")


def write_run(
    folder: Path,
    autonomy: float | None = None,
    cte_m: float = 0.3,
    val_mse: float = 0.01,
    seed: int = 1,
    overrides: tuple[str, ...] = ("model=tiny",),
    tracks: tuple[str, ...] = ("lake",),
    start_seeds: int = 1,
    root: str | None = None,
    fingerprint: str = "0123456789abcdef",
    **more: object,
) -> Path:
    """Write a finished run with the same figures on each track; autonomy None: without drives."""
    drive = None
    if autonomy is not None:
        figures = {"autonomy": [autonomy, 0.0], "cte_mean_m": [cte_m, 0.0], "drives": start_seeds}
        lost = round(10 * (1 - autonomy))
        figures["interventions"] = [lost, 0.0]
        figures["drives_without_intervention"] = 0 if lost else start_seeds
        drive = {"speed_mph": 20.0, "laps": 1.0, "seeds": start_seeds}
        drive["tracks"] = dict.fromkeys(tracks, figures)
    metrics = {"version": 1, "model": "tiny", "parameters": 41, "seed": seed, "wall_s": 12.0}
    metrics["open_loop"] = {part: {"mse": val_mse} for part in ("train", "val", "test")}
    metrics |= {"drive": drive, "data": {"fingerprint": fingerprint, "rows": 900}} | more
    (folder / ".hydra").mkdir(parents=True)
    (folder / "metrics.json").write_text(json.dumps(metrics))
    settings = dict(override.split("=", 1) for override in overrides)
    config = {"seed": seed, "data": {"root": root}, **settings}
    (folder / ".hydra" / "config.yaml").write_text(json.dumps(config))
    (folder / ".hydra" / "overrides.yaml").write_text(json.dumps([*overrides, f"seed={seed}"]))
    choices = {"hydra": {"runtime": {"choices": {"experiment": None}, "cwd": str(folder)}}}
    (folder / ".hydra" / "hydra.yaml").write_text(json.dumps(choices))
    (folder / "metrics.csv").write_text(
        f"epoch,train/loss,val/mse\n0,0.2,\n0,,{2 * val_mse}\n1,0.1,\n1,,{val_mse}\n"
    )
    write_status(folder, "finished")
    return folder


def change_status(folder: Path, **fields: object) -> None:
    """Change fields of a run's `status.json`."""
    path = folder / "status.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | fields))
