"""Policies of checkpoints, alone and for Gymnasium environments."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivezoo.one_line_errors import one_line_errors

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivezoo.training import Training
    from zoo.worlds.environments import EnvironmentPolicy


@one_line_errors
def load_policy(path: str | Path | Training) -> Callable[..., Any]:
    """Return a checkpoint's policy, a function of a frame and mph; see `zoo.policy`.

    Args:
        path: checkpoint's path, run's folder, `latest`, or what `train` returned.

    Raises:
        InputError: the checkpoint cannot be loaded.
    """
    from zoo.checkpoints.checkpoint_path import find_driver
    from zoo.checkpoints.policy import load_policy

    return load_policy(find_driver(path))


@one_line_errors
def policy(
    driver: str | Path | Training | Callable[..., Any],
    speed: float = 15.0,
    throttle: str = "hold",
    frame_rate: float = 15.0,
) -> EnvironmentPolicy:
    """Return a policy for the simulator's Gymnasium environments.

    >>> act = policy("latest")  # doctest: +SKIP
    >>> observation, reward, *rest = env.step(act(observation))  # doctest: +SKIP

    Args:
        driver: see `evaluate`.
        speed: speed to hold in mph.
        throttle: `hold` for that speed, `network` for the network's throttle.
        frame_rate: the environment's steps per second of simulated time.

    Raises:
        InputError: the checkpoint cannot be loaded, or predicts no throttle although it must.
        UsageError: a value is wrong.
    """
    from zoo.base.command_keys import constructed
    from zoo.checkpoints.checkpoint_path import find_driver
    from zoo.checkpoints.command import as_policy
    from zoo.checkpoints.policy import load_policy
    from zoo.evaluate.evaluate_options import EvaluateOptions
    from zoo.worlds.drive_loop import speed_controller
    from zoo.worlds.environments import EnvironmentPolicy
    from zoo.worlds.run_drives import check_throttle

    keys = {"speed": speed, "throttle": throttle, "frame_rate": frame_rate}
    settings = EvaluateOptions(**constructed(EvaluateOptions, keys))
    named = find_driver(driver)
    steering = load_policy(named) if isinstance(named, str) else as_policy(named)
    check_throttle(steering, settings.throttle)
    return EnvironmentPolicy(steering, speed_controller(settings), settings.frame_rate)
