"""The drivers of an entry and their drives, with figures and a digest; finished ones are kept."""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from zoo.base.bounded_files import MOST_JSON_BYTES, hash_file, read_text
from zoo.base.errors import InputError, UsageError, file_errors
from zoo.base.plain_files import parse_json
from zoo.base.terminal import counted
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.driving.baseline import Baseline
from zoo.driving.drive_record import Drive
from zoo.driving.metrics import measure
from zoo.driving.run_drives import all_drives, load_kept, run_drives
from zoo.results.benchmark_options import BASELINES, NO_CHECKPOINT
from zoo.results.result import Driver, DriveRecord, check_distinct
from zoo.results.suite import LAPS, Suite, SuiteDrive
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.record_fields import Count, Fields, check_fields
from zoo.scoring.drive_section import FAILURE_S
from zoo.scoring.track_scores import KeptDrive

MACHINE = ("latency_ms",)  # metrics that depend on the machine
UNFINISHED = "unfinished.jsonl"  # file of the finished drives of a benchmark
DECIMALS = 6  # of the rows in a digest


def drive_suite(
    drivers: Sequence[Driver],
    jobs: Sequence[tuple[int, SuiteDrive]],
    mean_steering: float | None,
    workers: int,
    console: Console,
    finished: "FinishedDrives | None" = None,
    executor: str = "processes",
) -> list[DriveRecord]:
    """Return the drives of some drivers, in the order of the jobs.

    Args:
        drivers: drivers of the entry.
        jobs: number of a driver, and drive of a suite.
        mean_steering: steering of the baseline `mean`, -1..1.
        workers: number of processes; 0 for one per core. It does not change the figures.
        console: console that shows the progress.
        finished: drives that are not repeated; each further one is added.
        executor: see `run_drives`.

    Raises:
        InputError: the simulator cannot be opened, or a process was killed.
    """
    drives = {} if finished is None else dict(finished.drives)
    # Laps take longest: begun last, they would leave the other processes without work.
    order = sorted(set(range(len(jobs))) - set(drives), key=lambda job: jobs[job][1].group != LAPS)
    files = [drivers[jobs[number][0]].file for number in order]
    for index, drive in run_drives(
        [_driver(file, mean_steering) for file in files],
        [jobs[number][1].scenario for number in order],
        workers=workers,
        what=f"driving {counted(len(order), 'road')}",
        console=console,
        # Other renderers draw other frames: the digest would depend on the machine.
        renderer="none" if files and files[0] in BASELINES else "software",
        first_only=[jobs[number][1].level > 0 for number in order],
        executor=executor,
    ):
        driver, planned = jobs[order[index]]
        drives[order[index]] = DriveRecord(
            checkpoint=driver,
            group=planned.group,
            track=planned.track,
            settings=planned.settings,
            figures=drive_figures(drive),
            digest=drive_digest(drive),
            level=planned.level,
        )
        if finished is not None:
            finished.add(order[index], drives[order[index]])
    return [drives[number] for number in range(len(jobs))]


def drive_again(
    drivers: Sequence[Driver],
    drives: Mapping[Path, tuple[int, SuiteDrive]],
    mean_steering: float | None,
    console: Console,
) -> None:
    """Repeat drives of a suite until they leave the road; write each and its film to a folder."""
    all_drives(
        [_driver(drivers[number].file, mean_steering) for number, _ in drives.values()],
        [planned.scenario for _, planned in drives.values()],
        [KeptDrive(folder, 1.0, film_last_s=FAILURE_S) for folder in drives],
        what="driving the worst again, for a film",
        console=console,
        renderer="software",
        first_only=True,
    )


def _driver(file: str, mean_steering: float | None) -> Baseline | str:
    return Baseline(file, mean_steering) if file in NO_CHECKPOINT else file


def drive_figures(drive: Drive) -> dict[str, float | None]:
    """Return the figures of a drive that do not depend on the machine."""
    figures = measure(drive)
    if drive.nan_frames:
        figures["nan_frames"] = drive.nan_frames
    return {
        name: value if math.isfinite(value) else None
        for name, value in figures.items()
        if name not in MACHINE
    }


def drive_digest(drive: Drive) -> str:
    """Return 16 hexadecimal digits of a drive's rows; neither latency nor wall time is in it."""
    names = "steering", "throttle", "speed_mph", "cross_track_m", "intervention"
    rows = np.stack([np.asarray(getattr(drive, name), np.float64) for name in names], -1)
    rounded = np.round(rows, DECIMALS) + 0.0  # no negative zeros
    return hashlib.sha256(rounded.astype("<f8").tobytes()).hexdigest()[:16]


class _Finished(Fields):
    """A row of the file of finished drives."""

    job: Count
    drive: DriveRecord


class FinishedDrives:
    """A file of finished drives: a line that says what is driven, then a line for each drive.

    Args:
        folder: folder of the benchmark.
        drivers: drivers of the entry.
        suite: suite to drive.

    Attributes:
        drives: finished drives by the number of their job.

    Raises:
        InputError: the file belongs to other checkpoints, another suite or other code, or is
            damaged.
    """

    def __init__(self, folder: Path, drivers: Sequence[Driver], suite: Suite) -> None:
        self.path = folder / UNFINISHED
        self.drives: dict[int, DriveRecord] = {}
        first = {
            "suite": suite.name,
            "roads": [suite.roads, suite.usual],
            "scenarios": [repr(drive.scenario) for drive in suite.drives],
            "mean_steering": suite.mean_steering,
            "drivers": [driver.sha256 or driver.file for driver in drivers],
            "code": code_fingerprint()["hash"],
        }
        text = read_text(self.path, MOST_JSON_BYTES) if self.path.is_file() else ""
        # The text after the last line break is a drive that was written in part.
        lines = text.split("\n")[:-1] or [json.dumps(first)]
        for number, line in enumerate(lines, 1):
            where = f"{self.path}: row {number}; delete this file and start again"
            try:
                content = parse_json(line)
            except ValueError as error:
                raise InputError(f"{where}: {error}") from None
            if number == 1:
                content = content if isinstance(content, dict) else {}
                if other := [key for key, value in first.items() if content.get(key) != value]:
                    raise InputError(
                        f"{self.path}: {other[0]}: differ from the drives that were begun; name "
                        "another folder with out=, or delete this file"
                    )
            else:
                row = check_fields(_Finished, content, where)
                self.drives[row.job] = row.drive
        with file_errors(self.path, "{}; its drives are kept"):
            write_whole(self.path, "\n".join([*lines, ""]))

    def add(self, job: int, drive: DriveRecord) -> None:
        """Keep a finished drive."""
        self.drives[job] = drive
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"job": job, "drive": drive.model_dump()}) + "\n")


def find_drivers(names: Sequence[str], suite: Suite) -> list[Driver]:
    """Return the drivers of an entry: one baseline, or checkpoints of several training seeds.

    Raises:
        UsageError: a baseline is named together with other drivers.
        InputError: a checkpoint cannot be read, is of the training of an earlier one or has another
            network than the first; or the suite has no mean steering.
    """
    if baselines := [name for name in names if name in NO_CHECKPOINT]:
        if len(names) > 1:
            raise UsageError(f"{baselines[0]}: a baseline is an entry of its own; name it alone")
        if names[0] == "mean" and suite.mean_steering is None:
            raise InputError(
                f"mean: the suite {suite.name} has no mean_steering; add it to the suite's file"
            )
        facts: dict[str, Any] = {"sha256": None, "parameters": 0, "training_seed": None, "data": ""}
        return [Driver(file=names[0], model=names[0], **facts)]
    drivers = [read_driver(find_checkpoint(name)) for name in names]
    check_distinct(drivers)
    return drivers


def read_driver(path: Path) -> Driver:
    """Return the description of a checkpoint.

    Raises:
        InputError: the checkpoint cannot be read.
    """
    policy = load_kept(str(path))
    seed = policy.config.get("seed")
    return Driver(
        file=str(path),
        sha256=hash_file(path),
        model=policy.name,
        parameters=policy.parameters,
        training_seed=seed if isinstance(seed, int) else None,
        data=str(policy.data.get("fingerprint") or ""),
        tied=policy.scored().tied,
    )
