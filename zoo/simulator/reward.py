"""Rewards and ends of an environment's episodes: our own, and those of other environments.

They are functions of `info`, which `zoo.simulator.env` describes. "Far" off the road is 13.75
widths of it: CarRacing's playfield ends 1,100 units beyond the mean radius of a track 80 units
wide.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from zoo.base.errors import InputError, hint
from zoo.base.rig import MPS_PER_MPH

Info = dict[str, Any]
Reward = Callable[[Info, Info, bool], float]
Termination = Callable[[Info], bool]
Chosen = TypeVar("Chosen")

DONKEY_MAX_CTE_M = 8.0  # gym-donkeycar's default
FAR_WIDTHS = 13.75


def progress_reward(before: Info, info: Info, terminated: bool) -> float:
    """Return the metres of progress along the lap; 0 off the road."""
    return 0.0 if info["off_road"] else info["driven_m"] - before["driven_m"]


def donkeycar_reward(before: Info, info: Info, terminated: bool) -> float:
    """Return gym-donkeycar's: m/s, fewer off the centre; -1 at the end, -2 at a wall."""
    if terminated or abs(info["cte"]) > DONKEY_MAX_CTE_M:
        return -1.0
    if info["hit"]:
        return -2.0
    return (1 - abs(info["cte"]) / DONKEY_MAX_CTE_M) * info["speed_mph"] * MPS_PER_MPH


def carracing_reward(before: Info, info: Info, terminated: bool) -> float:
    """Return CarRacing's: 1000 for a lap, -0.1 for a frame, -100 for an end far off the road.

    A piece of the lap counts when it is driven for the first time; it has no tiles here.
    """
    if terminated and is_far_off(info):
        return -100.0
    return 1000 * (info["furthest"] - before["furthest"]) - 0.1


def donkeycar_termination(info: Info) -> bool:
    """Return whether the car is 8 m off the centre, or touches a wall."""
    return abs(info["cte"]) > DONKEY_MAX_CTE_M or bool(info["hit"])


def carracing_termination(info: Info) -> bool:
    """Return whether a lap is driven, or the car is far off the road."""
    return info["lap"] >= 1 or is_far_off(info)


def is_far_off(info: Info) -> bool:
    """Return whether the car is as far off the road as CarRacing allows."""
    return abs(info["cte"]) > FAR_WIDTHS * info["width"]


REWARDS: dict[str, Reward] = {
    "progress": progress_reward,
    "donkeycar": donkeycar_reward,
    "carracing": carracing_reward,
}
TERMINATIONS: dict[str, Termination] = {
    "donkeycar": donkeycar_termination,
    "carracing": carracing_termination,
}


def named_function(key: str, value: str | Chosen, functions: dict[str, Chosen]) -> Chosen:
    """Return the function of a name, or the function itself.

    Raises:
        InputError: there is no such name.
    """
    if callable(value):
        return value
    if str(value) not in functions:
        raise InputError(f"{key}={value}: {hint(str(value), [*functions, 'a function'])}")
    return functions[str(value)]
