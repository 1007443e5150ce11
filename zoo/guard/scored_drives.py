"""Drives with the scores of their windows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from rich.console import Console

from zoo.base.process_pool import drive_in_processes
from zoo.cli.console_progress import progress_bar
from zoo.guard.conditions import Condition
from zoo.guard.labelled_windows import LabelledWindows, label_windows, window_scores
from zoo.guard.observed_drive import ObservedDrive, observe_drive
from zoo.monitor.scores import METHODS, Score


@dataclass(frozen=True)
class ScoredDrive:
    """A drive's windows and their scores.

    Attributes:
        condition: what was driven; None for a nominal drive.
        seed: seed of the start.
        driven_m: distance driven in metres.
        windows: windows of the drive.
        before: by method and lead in seconds, the scores of windows before a failure, float [n].
        normal: by method, the scores of normal windows, float [n].
    """

    condition: Condition | None
    seed: int
    driven_m: float
    windows: LabelledWindows
    before: dict[str, dict[int, np.ndarray]]
    normal: dict[str, np.ndarray]


@dataclass(frozen=True)
class Fleet:
    """Driver of a checkpoint in several processes.

    Attributes:
        checkpoint: checkpoint file.
        ensemble: further checkpoints, whose steering is compared.
        samples: passes of Monte-Carlo dropout for each frame.
        workers: number of processes; 0 for one per core.
        console: console that shows the progress.
    """

    checkpoint: str
    ensemble: tuple[str, ...]
    samples: int
    workers: int
    console: Console

    def observe(
        self, conditions: Sequence[Condition], what: str, take: Callable[[int, ObservedDrive], None]
    ) -> None:
        """Drive conditions and hand each number and drive to `take`; its signals are large."""
        jobs = [
            (self.checkpoint, self.ensemble, self.samples, one.noise, one.setup)
            for one in conditions
        ]
        with progress_bar(f"{what}: {len(jobs)} drives", self.console) as show:
            for number, drive in drive_in_processes(observe_drive, jobs, self.workers, show):
                take(number, drive)


def score_drive(
    drive: ObservedDrive, condition: Condition | None, seed: int, scores: dict[str, Score]
) -> ScoredDrive:
    """Return the scores of a drive's windows, by each method."""
    windows = label_windows(drive.time_s, drive.intervention)
    before: dict[str, dict[int, np.ndarray]] = {}
    normal: dict[str, np.ndarray] = {}
    for method, score in scores.items():
        of_frames = score(drive.signals[METHODS[method].signal])
        before[method] = {
            lead: window_scores(of_frames, ranges) for lead, ranges in windows.before.items()
        }
        normal[method] = window_scores(of_frames, windows.normal)
    return ScoredDrive(condition, seed, drive.driven_m, windows, before, normal)
