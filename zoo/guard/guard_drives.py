"""The drives of a guard: observed ones with the scores of their windows, and paired ones."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from zoo.checkpoints.command import Command, Policy, PolicyWrapper
from zoo.checkpoints.policy import load_policy
from zoo.drives.bootstrap import Estimate
from zoo.drives.drive_record import Drive
from zoo.drives.metrics import measure
from zoo.guard.conditions import Condition, Noisy
from zoo.guard.guard_options import GuardOptions
from zoo.guard.warning_figures import LabelledWindows, label_windows, window_scores
from zoo.monitor.scores import METHODS, Score, Threshold
from zoo.monitor.signals import Source, signal_sources
from zoo.worlds.run_drives import Keep, all_drives, run_drives
from zoo.worlds.scenario import Scenario
from zoo.worlds.world import World

LEAST_MPH = 4.0  # a drive ends when its mean speed is below 3 mph


@dataclass(frozen=True)
class ObservedDrive:
    """A drive of N rows with its signals.

    Attributes:
        drive: the drive.
        signals: by name, the signal of each row, [N, ...].
        signal_ms: by name, median processor time of a signal in milliseconds.
    """

    drive: Drive
    signals: dict[str, np.ndarray]
    signal_ms: dict[str, float]


class Observer(PolicyWrapper):
    """Policy that keeps the signals of the frames it is called with.

    Args:
        policy: policy that drives.
        sources: sources of the signals by name.
    """

    def __init__(self, policy: Policy, sources: dict[str, Source]) -> None:
        super().__init__(policy)
        self._sources = sources
        self.signals: dict[str, list] = {name: [] for name in sources}
        self.took_s: dict[str, list[float]] = {name: [] for name in sources}

    def __call__(self, frame: Any, speed_mph: float) -> Command:
        """Return the policy's command for a frame."""
        command = self.policy(frame, speed_mph)
        for name, source in self._sources.items():
            began = time.process_time()
            self.signals[name].append(source(frame, speed_mph, command))
            self.took_s[name].append(time.process_time() - began)
        return command


@dataclass(frozen=True)
class Observed(Noisy):
    """What makes the observer of a checkpoint.

    Args:
        ensemble: further checkpoints, whose steering is compared.
        samples: passes of Monte-Carlo dropout for each frame.
    """

    ensemble: tuple[str, ...]
    samples: int

    def policy(self, world: World, scenario: Scenario) -> Observer:
        """Return the observer."""
        policy = super().policy(world, scenario)
        others = [load_policy(one).in_car(world.rig) for one in self.ensemble]
        return Observer(policy, signal_sources(policy, self.samples, others)[0])


class KeptSignals(Keep):
    """The signals of every frame of a drive."""

    def result(self, drive: Drive, policy: Observer, world: World) -> ObservedDrive:
        """Return the observed drive."""
        signals = {name: np.array(values) for name, values in policy.signals.items()}
        took_s = policy.took_s.items()
        return ObservedDrive(drive, signals, {k: 1000 * float(np.median(v)) for k, v in took_s})


class KeptCounts(Keep):
    """The interventions, distance, speed and alarms of a drive."""

    def result(self, drive: Drive, policy: Policy, world: World) -> dict[str, float]:
        """Return the figures; without a guard there are no alarms."""
        figures = measure(drive)
        counts = {"interventions": int(figures["interventions"]), "driven_m": figures["driven_m"]}
        return counts | {"speed_mph": figures["speed_mph"], "alarms": policy.alarms or 0}


@dataclass(frozen=True)
class ScoredDrive:
    """A drive's windows and their scores.

    Attributes:
        condition: what was driven.
        driven_m: distance driven in metres.
        windows: windows of the drive.
        before: by method and lead in seconds, the scores of windows before a failure, float [n].
        normal: by method, the scores of normal windows, float [n].
    """

    condition: Condition
    driven_m: float
    windows: LabelledWindows
    before: dict[str, dict[int, np.ndarray]]
    normal: dict[str, np.ndarray]


@dataclass(frozen=True)
class Fitted:
    """A fitted method: its score, the threshold, and milliseconds per frame."""

    score: Score
    threshold: Threshold
    frame_ms: float


class Warnings(NamedTuple):
    """The figures of `warning_figures` for a group of conditions, a method and a lead."""

    group: str
    method: str
    lead_s: int
    figures: dict[str, Estimate]


@dataclass(frozen=True)
class GuardResult:
    """Result of the command.

    Attributes:
        checkpoint: checkpoint file.
        options: options of the command.
        fitted: by method, its score and threshold.
        drives: nominal drives that count false alarms, and the drives of the conditions.
        figures: figures of the warnings.
        method: method of the guard file.
        notes: lines about what could not be measured.
        pairs: for each drive's condition `without`, `guarded` and `slower`, the figures of
            `KeptCounts`; None if there were no paired drives.
    """

    checkpoint: str
    options: GuardOptions
    fitted: dict[str, Fitted]
    drives: list[ScoredDrive]
    figures: list[Warnings]
    method: str
    notes: list[str] = field(default_factory=list)
    pairs: list[dict] | None = None

    def alarms_without_failure(self, group: str, method: str) -> float:
        """Return the share of alarms in windows of a group that no failure follows."""
        scores = joined([one.normal[method] for one in of_group(self.drives, group)])
        threshold = self.fitted[method].threshold.value
        return float((scores > threshold).mean()) if len(scores) else float("nan")


def of_group(drives: Sequence[ScoredDrive], group: str) -> list[ScoredDrive]:
    """Return the drives of a group of conditions."""
    return [one for one in drives if one.condition.group == group]


def joined(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Return the scores of several drives, float [N]."""
    return np.concatenate([np.zeros(0), *parts])


def observe(
    checkpoint: str,
    ensemble: tuple[str, ...],
    conditions: Sequence[Condition],
    options: GuardOptions,
    what: str,
    console: Console,
) -> Iterator[tuple[int, ObservedDrive]]:
    """Drive conditions and yield each number and drive; its signals are large."""
    return run_drives(
        [Observed(checkpoint, one.noise, ensemble, options.samples) for one in conditions],
        [one.scenario for one in conditions],
        KeptSignals(),
        options.workers,
        f"{what}: {len(conditions)} drives",
        console,
    )


def drive_pairs(result: GuardResult, guard: str, usual_mph: float, console: Console) -> list[dict]:
    """Drive conditions with a guard, then without one at the mean speed of the guarded drive.

    A slower car fails less often, with or without warnings; the second drive shows how much of
    the effect is the speed alone.

    Args:
        result: result with the drives without a guard.
        guard: guard file.
        usual_mph: speed of the drives without a guard.
        console: console that shows the progress.
    """
    drives = result.drives
    noisy = [Noisy(result.checkpoint, one.condition.noise) for one in drives]
    workers = result.options.workers

    def figures(scenarios: list[Scenario], what: str) -> list[dict]:
        what = f"{what}: {len(scenarios)} drives"
        return all_drives(noisy, scenarios, KeptCounts(), workers, what, console)

    scenarios = [one.condition.scenario for one in drives]
    guarded = figures([replace(one, guard=guard) for one in scenarios], "with the guard")
    slower = [
        replace(one, speed=max(own["speed_mph"], LEAST_MPH))
        for one, own in zip(scenarios, guarded, strict=True)
    ]
    return [
        {
            "condition": one.condition.name,
            "without": {"interventions": one.windows.failures, "driven_m": one.driven_m}
            | {"speed_mph": usual_mph, "alarms": 0},
            "guarded": with_guard,
            "slower": at_its_speed,
        }
        for one, with_guard, at_its_speed in zip(
            drives, guarded, figures(slower, "without the guard"), strict=True
        )
    ]


def score_drive(
    observed: ObservedDrive, condition: Condition, scores: dict[str, Score]
) -> ScoredDrive:
    """Return the scores of a drive's windows, by each method."""
    windows = label_windows(observed.drive.time_s, observed.drive.intervention)
    before: dict[str, dict[int, np.ndarray]] = {}
    normal: dict[str, np.ndarray] = {}
    for method, score in scores.items():
        of_frames = score(observed.signals[METHODS[method].signal])
        before[method] = {
            lead: window_scores(of_frames, ranges) for lead, ranges in windows.before.items()
        }
        normal[method] = window_scores(of_frames, windows.normal)
    return ScoredDrive(condition, observed.drive.driven_m, windows, before, normal)
