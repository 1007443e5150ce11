"""A drive in which the signals of every frame are kept."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch

from simulator.world import World
from zoo.checkpoints.command import (
    Command,
    PolicyFunction,
    call_policy,
    expect_steering,
    reset_policy,
)
from zoo.checkpoints.policy import load_policy
from zoo.evaluate.many_drives import Setup, drive_setup, open_setup
from zoo.guard.conditions import conditioned_policy
from zoo.monitor.signals import Source, signal_sources


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


class Observer:
    """Policy that keeps the signals of the frames it is called with.

    Args:
        policy: policy that drives.
        sources: sources of the signals by name.
    """

    def __init__(self, policy: PolicyFunction, sources: dict[str, Source]) -> None:
        self._policy, self._sources = policy, sources
        self.signals: dict[str, list] = {name: [] for name in sources}
        self.took_s: dict[str, list[float]] = {name: [] for name in sources}

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the policy's command for a frame."""
        command = call_policy(self._policy, frame, speed_mph)
        for name, source in self._sources.items():
            began = time.process_time()
            self.signals[name].append(source(frame, speed_mph, command))
            self.took_s[name].append(time.process_time() - began)
        return command

    def reset(self) -> None:
        """Let the policy forget the frames before."""
        reset_policy(self._policy)

    def expect(self, steering: np.ndarray) -> None:
        """Tell the policy which steering the wheels will have."""
        expect_steering(self._policy, steering)

    @property
    def latency_s(self) -> float:
        """Return the latency that the policy assumes; it has none if that has none."""
        return self._policy.latency_s  # type: ignore[attr-defined]

    @latency_s.setter
    def latency_s(self, latency_s: float) -> None:
        self._policy.latency_s = latency_s  # type: ignore[attr-defined]


@contextmanager
def one_thread() -> Iterator[None]:
    """Let torch compute in one thread: images are too small for several, which wait for others."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def observe_drive(
    checkpoint: str,
    ensemble: tuple[str, ...],
    samples: int,
    noise: float,
    setup: Setup,
    report: Callable[[float], None] | None = None,
) -> ObservedDrive:
    """Drive once in this process and keep the signals of every frame.

    Args:
        checkpoint: checkpoint file.
        ensemble: further checkpoints, whose steering is compared.
        samples: see `signal_sources`.
        noise: see `Condition`; 0 leaves the network as it is.
        setup: setup of the drive.
        report: function called at every frame with the share of the drive that is done, 0..1.
    """
    world: World = open_setup(setup, "auto")
    with one_thread():
        policy = conditioned_policy(checkpoint, noise, setup.seed)
        others = [load_policy(one) for one in ensemble]
        observer = Observer(policy, signal_sources(policy, samples, others)[0])
        drive = drive_setup(observer, world, setup, None, report)
    world.pictures.close()
    return ObservedDrive(
        time_s=drive.time_s,
        intervention=drive.intervention,
        driven_m=drive.driven_m,
        signals={name: np.array(values) for name, values in observer.signals.items()},
        signal_ms={
            name: 1000 * float(np.median(values)) for name, values in observer.took_s.items()
        },
    )
