"""What each study measures of its runs: rows of its table; `ROWS` is named by the study's YAML.

A function of `ROWS` drives what is missing, and returns the rows of one entry whose trainings have
finished.
"""

import hashlib
import itertools
import re
import shlex
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from benchmarks.board_rows import SUITE, Row, board_rows
from benchmarks.carry import carried_rows
from benchmarks.study_grid import Entry, Study, kept, run_logged
from zoo.base.plain_files import read_json
from zoo.base.whole_file import json_text, write_whole
from zoo.checkpoints.checkpoint import build_checkpoint, read_checkpoint_file
from zoo.checkpoints.checkpoint_path import PACKAGED
from zoo.checkpoints.new_checkpoint import checkpoint_bytes, lean_contents
from zoo.checkpoints.policy_base import Command
from zoo.driving.drive_log import summarize
from zoo.driving.drive_record import Drive, DriveRow
from zoo.driving.run_drives import Keep, run_drives
from zoo.driving.scenario import Scenario
from zoo.driving.speed_controller import PI, Constant, SpeedController
from zoo.results.checked_result import read_result
from zoo.results.result import NAME
from zoo.results.suite import OVERALL
from zoo.runs.metrics_file import read_metrics_file

STALLED_S = 30.0


def per_run(measure: Callable[[Study, Entry, Path], Iterable[Row]]) -> Callable:
    """Return a function of all rows of an entry, from one of the rows of a run."""
    return lambda study, entry: [
        {**entry.labels, "seed": run.name, **row}
        for run in entry.finished
        for row in measure(study, entry, run)
    ]


def columns(figures: Mapping | None, prefix: str, names: Iterable[str], digits: int = 4) -> Row:
    """Return rounded figures, means of several drives; empty cells where there are none."""
    row: Row = {}
    for name in names:
        value = (figures or {}).get(name, "")
        value = value[0] if isinstance(value, list | tuple) else value
        row[f"{prefix}{name}"] = value if value == "" else round(value, digits)
    return row


def result_rows(study: Study, entry: Entry, run: Path) -> Iterable[Row]:
    """Return a run's row: its test rows, and, if it drove, its laps of lake and mountain."""
    metrics, words = read_metrics_file(run), study.command(entry)
    row: Row = {name: metrics[name] for name in ("parameters", "epochs", "best_epoch")}
    row["train_s"] = round((metrics["seconds_per_epoch"] or 0) * metrics["epochs"], 1)
    constant = metrics["baselines"]["test"]
    predictors = metrics["open_loop"]["test"], constant["always zero"], constant["mean"]
    for prefix, figures in zip(("test_", "test_zero_", "test_mean_"), predictors, strict=True):
        row |= columns(figures, prefix, ("mse", "balanced_mae"), 6)
    for track in ("lake", "mountain") if metrics["drive"] else ():
        driven = metrics["drive"]["tracks"].get(track)
        names = ("autonomy", "interventions", "cte_mean_m", "cte_max_m")
        row |= columns(driven, f"{track}_", names)
    yield row | {"command": shlex.join(["drivezoo", "train", *words, f"seed={run.name}"])}


class LapFigures(Keep):
    """A drive's figures; those of a throttle that does not move the car are only `stalled_m`.

    Such a drive ends, since putting the car back at 0 mph would not help.
    """

    moved_s, stalled = 0.0, False

    def show(self, frame: object, row: DriveRow) -> bool:
        """Return whether the car has stood still for too long."""
        self.moved_s = row.time_s if row.speed_mph > 1 else self.moved_s
        self.stalled = row.time_s - self.moved_s > STALLED_S
        return self.stalled

    def result(self, drive: Drive, policy: object, world: object) -> dict:
        """Return the figures, or the distance in metres after which the car stood still."""
        return {"stalled_m": round(drive.driven_m)} if self.stalled else summarize(drive)


class RuleOfA(SpeedController):
    """The throttle of write-up A's driver."""

    set_mph = None

    def throttle(self, command: Command, speed_mph: float, now_s: float) -> float:
        """Return 0.2 above 20 mph, else 0.5."""
        return 0.2 if speed_mph > 20 else 0.5


def lap(
    control: str, start_seed: int = 0, **settings: Any
) -> tuple[Scenario, SpeedController | None]:
    """Return a drive, of a lap if nothing else is set, and its speed controller."""
    kind, text = control.removesuffix(" mph").split()
    drive = Scenario(seed=start_seed, **{"laps": 1.0, **settings})
    if kind in ("throttle", "rule"):  # it starts at a standstill
        speed = Constant(float(text)) if kind == "throttle" else RuleOfA()
        return replace(drive, throttle="network"), speed
    speed = PI(float(text), kp=0.5) if kind == "proportional" else None
    return replace(drive, speed=float(text)), speed


def driven(study: Study, entry: Entry, run: Path) -> list[tuple[dict, dict[str, float]]]:
    """Return settings and figures of the drives that the study's YAML lists for a run."""
    settings = [
        dict(zip(drives["axes"], values, strict=True))
        for drives in study.config["drives"]
        if all(entry.labels[key] in names for key, names in drives.get("where", {}).items())
        for values in itertools.product(*drives["axes"].values())
    ]
    names = ("-".join(map(str, drive.values())) for drive in settings)
    paths = [run / "drives" / f"{re.sub('[ :]', '_', name)}.json" for name in names]
    missing = [number for number, path in enumerate(paths) if not path.is_file()]
    laps = [lap(**settings[number]) for number in missing]
    checkpoint = str(run / "checkpoints" / "best.ckpt")
    scenarios, speeds = [scenario for scenario, _ in laps], [speed for _, speed in laps]
    keeps = [LapFigures() for _ in laps]
    workers = study.options.threads
    for number, figures in run_drives(checkpoint, scenarios, keeps, workers, speeds=speeds):
        kept(paths[missing[number]], lambda driven=figures: driven)
    return list(zip(settings, map(read_json, paths), strict=True))


def claim_rows(study: Study, entry: Entry, run: Path) -> Iterable[Row]:
    """Return a row for each drive of a run."""
    names = ("autonomy", "interventions", "cte_mean_m", "cte_max_m", "speed_mph", "stalled_m")
    pretrained = OmegaConf.load(run / ".hydra" / "config.yaml").model.weights
    for settings, figures in driven(study, entry, run):
        yield {
            "experiment": entry.words[0].partition("=")[2],
            "training": "quick" if study.options.quick else "published",
            "weights": "imagenet" if pretrained else "",
            **settings,
            **columns(figures, "", names),
        }


def drive_rows(study: Study, entry: Entry, run: Path) -> Iterable[Row]:
    """Return a row for each drive of a run, with the metres that it drove."""
    names = ("autonomy", "interventions", "driven_m", "cte_max_m")
    for settings, figures in driven(study, entry, run):
        yield settings | columns(figures, "", names)


def pretrained_rows(study: Study, entry: Entry) -> list[Row]:
    """Drive the checkpoint of a network, and keep it with its facts, which are its rows.

    Raises:
        InputError: the drives failed.
    """
    for run in entry.finished:
        metrics, path = read_metrics_file(run), run / "checkpoints" / "best.ckpt"
        contents = lean_contents(read_checkpoint_file(path))
        # From `data.record`, a further training records what this one was trained on.
        contents["drivezoo"]["config"]["data"]["root"] = None
        checkpoint, data = build_checkpoint(contents, path), checkpoint_bytes(contents)
        packaged = entry.folder / f"{entry.name}.ckpt"
        write_whole(packaged, data)
        sha256, laps = hashlib.sha256(data).hexdigest(), study.config["laps"]
        folder, workers = entry.folder / sha256[:8], f"workers={study.options.threads}"
        evaluate = ["zoo.commands.evaluate", str(packaged), "track=lake", f"seeds={laps}"]
        benchmark = ["zoo.commands.benchmark", str(packaged), "suite=quick", f"entry={entry.name}"]
        for name, words in (("lake", evaluate), ("quick", benchmark)):
            if not list((folder / name).glob("*.json")):
                run_logged(folder / f"{name}.txt", [*words, workers, f"out={folder / name}"], 1)
        figures = read_metrics_file(folder / "lake")["tracks"]["lake"]
        result = read_result(folder / "quick")
        facts = {
            "network": type(checkpoint.network).__name__,
            "parameters": metrics["parameters"],
            "bytes": len(data),
            "sha256": sha256,
            "licence": "MIT",
            "command": shlex.join(["drivezoo", "train", *study.command(entry)]),
            "data": {k: v for k, v in checkpoint.data.items() if k != "row_hashes"},
            "code": metrics["code"],
            "versions": metrics["versions"],
            "drives": {
                "lake": {
                    "command": f"drivezoo evaluate {entry.name} track=lake seeds={laps}",
                    "drives": figures["drives"],
                    "kept": figures["drives_without_intervention"],
                    "autonomy": figures["autonomy"][0],
                    "cte_mean_m": figures["cte_mean_m"][0],
                },
                "unseen": {
                    "command": f"drivezoo benchmark {entry.name} suite=quick",
                    "drives": len(result.drives),
                    "kept": sum(not drive.figures["interventions"] for drive in result.drives),
                    "digest": result.digest,
                },
            },
        }
        study.files[PACKAGED / packaged.name] = data
        study.files[PACKAGED / f"{entry.name}.json"] = json_text(facts)
    return []


def dev_rows(study: Study, entry: Entry, run: Path) -> Iterable[Row]:
    """Return the share of clean drives of a run's last epoch on the board's development roads."""
    folder = run / "dev"
    if not (folder / NAME).is_file():
        words = [str(entry.checkpoint(run)), f"suite={SUITE}", "split=dev", f"out={folder}"]
        words.append(f"workers={study.options.threads}")
        run_logged(run / "dev.txt", ["zoo.commands.benchmark", *words], 1)
    figures = read_result(folder).groups[OVERALL]["without_intervention"]
    yield {"clean": figures.value}


ROWS: dict[str, Callable[[Study, Entry], list[Row]]] = {
    "results": per_run(result_rows),
    "board": board_rows,
    "claims": per_run(claim_rows),
    "drives": per_run(drive_rows),
    "pretrained": pretrained_rows,
    "dev_roads": per_run(dev_rows),
    "carried": per_run(carried_rows),
}
