"""The drives of a guard: observed ones with the scores of their windows, and paired ones."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.console import Console

from zoo.checkpoints.command import Command, Policy, PolicyWrapper
from zoo.checkpoints.policy import load_policy
from zoo.drives.drive_record import Drive
from zoo.drives.metrics import measure
from zoo.guard.conditions import Condition, Noisy
from zoo.guard.labelled_windows import LabelledWindows, label_windows, window_scores
from zoo.monitor.scores import METHODS, Score
from zoo.monitor.signals import Source, signal_sources
from zoo.worlds.run_drives import Keep, PolicyMaker, all_drives, run_drives
from zoo.worlds.scenario import Scenario
from zoo.worlds.world import World

LEAST_MPH = 4.0  # a drive ends when its mean speed is below 3 mph


@dataclass(frozen=True)
class ObservedDrive:
    """Signals and interventions of a drive of N rows.

    Attributes:
        time_s: time of each row in seconds, float [N].
        intervention: whether an intervention began, bool [N].
        driven_m: distance driven in metres.
        signals: by name, the signal of each row, [N, ...].
        signal_ms: by name, median processor time of a signal in milliseconds.
    """

    time_s: np.ndarray
    intervention: np.ndarray
    driven_m: float
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
class Observed(PolicyMaker):
    """What makes the observer of a checkpoint.

    Args:
        noisy: what makes the policy that drives.
        ensemble: further checkpoints, whose steering is compared.
        samples: passes of Monte-Carlo dropout for each frame.
    """

    noisy: Noisy
    ensemble: tuple[str, ...]
    samples: int

    def policy(self, world: World, scenario: Scenario) -> Observer:
        """Return the observer."""
        policy = self.noisy.policy(world, scenario)
        others = [load_policy(one) for one in self.ensemble]
        return Observer(policy, signal_sources(policy, self.samples, others)[0])


class KeptSignals(Keep):
    """The signals of every frame of a drive."""

    def result(self, drive: Drive, policy: Observer, world: World) -> ObservedDrive:
        """Return the observed drive."""
        return ObservedDrive(
            time_s=drive.time_s,
            intervention=drive.intervention,
            driven_m=drive.driven_m,
            signals={name: np.array(values) for name, values in policy.signals.items()},
            signal_ms={
                name: 1000 * float(np.median(values)) for name, values in policy.took_s.items()
            },
        )


@dataclass(frozen=True)
class Fleet:
    """Driver of a checkpoint in several processes.

    Attributes:
        checkpoint: checkpoint file.
        ensemble, samples: see `Observed`.
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
        for number, drive in run_drives(
            [
                Observed(Noisy(self.checkpoint, one.noise), self.ensemble, self.samples)
                for one in conditions
            ],
            [one.scenario for one in conditions],
            KeptSignals(),
            self.workers,
            f"{what}: {len(conditions)} drives",
            self.console,
        ):
            take(number, drive)

    def drive_pairs(
        self, guard: str, conditions: Sequence[Condition]
    ) -> tuple[list["Driven"], list["Driven"]]:
        """Drive conditions with a guard, then without one at the mean speed of the guarded drive.

        A slower car fails less often, with or without warnings; the second drive shows how much of
        the effect is the speed alone.

        Args:
            guard: guard file.
            conditions: conditions to drive.
        """
        watched = [replace(one.scenario, guard=guard) for one in conditions]
        with_guard = self._drive(conditions, watched, "with the guard")
        slower = [
            replace(one.scenario, speed=max(driven.speed_mph, LEAST_MPH))
            for one, driven in zip(conditions, with_guard, strict=True)
        ]
        return with_guard, self._drive(conditions, slower, "without the guard")

    def _drive(
        self, conditions: Sequence[Condition], scenarios: list[Scenario], what: str
    ) -> list["Driven"]:
        noisy = [Noisy(self.checkpoint, one.noise) for one in conditions]
        what = f"{what}: {len(scenarios)} drives"
        return all_drives(noisy, scenarios, KeptCounts(), self.workers, what, self.console)


@dataclass(frozen=True)
class Driven:
    """Figures of a drive.

    Attributes:
        interventions: number of interventions.
        driven_m: distance driven in metres.
        speed_mph: mean speed in mph.
        alarms: how often the guard began to fire; 0 without a guard.
    """

    interventions: int
    driven_m: float
    speed_mph: float
    alarms: int = 0


class KeptCounts(Keep):
    """The interventions, speed and alarms of a drive."""

    def result(self, drive: Drive, policy: Policy, world: World) -> Driven:
        """Return the figures."""
        figures = measure(drive)
        return Driven(
            int(figures["interventions"]),
            figures["driven_m"],
            figures["speed_mph"],
            policy.alarms or 0,
        )


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
