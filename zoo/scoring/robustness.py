"""Robustness: drives with one perturbation at a time, over a range of values."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

import numpy as np
from rich.table import Table

from zoo.base.errors import InputError, UsageError, hint, placed_errors
from zoo.base.registry import Registry
from zoo.driving.scenario import Scenario
from zoo.simulator.track_names import short_name
from zoo.simulator.weather import Weather, random_weather

Change = Callable[[Scenario, float], Scenario]


@dataclass(frozen=True)
class Perturbation:
    """One quantity of a scenario that is varied.

    Attributes:
        label: name with unit, for the plot.
        values: values in rising order.
        apply: function of a scenario and a value that returns the changed scenario.
        usual: function of a scenario that returns its present value, which is driven, too.
    """

    label: str
    values: tuple[float, ...]
    apply: Change
    usual: Callable[[Scenario], float]


def _of(label: str, path: str, *values: float) -> Perturbation:
    """Return the perturbation of a scenario's attribute, such as `weather.camera.right_m`."""

    def change(part: Any, names: Sequence[str], value: float) -> Any:
        name, *below = names
        return replace(
            part, **{name: change(getattr(part, name), below, value) if below else value}
        )

    return Perturbation(
        label,
        values,
        lambda scenario, value: change(_drawn(scenario, path), path.split("."), value),
        lambda scenario: float(attrgetter(path)(_drawn(scenario, path))),
    )


def _drawn(scenario: Scenario, path: str) -> Scenario:
    """Return a scenario whose random weather, if it changes, is drawn as the world draws it."""
    if isinstance(scenario.weather, Weather) or not path.startswith("weather."):
        return scenario
    return replace(scenario, weather=random_weather(np.random.default_rng(scenario.seed)))


SHOWN = {"autonomy": "{:.0%}", "cte_mean_m": "{:.2f}"}
LOW_SUN = "sun's elevation, deg (low: long shadows)"
_OWN = {
    "brightness": _of("brightness, factor", "weather.brightness", 0.3, 0.6, 1.0, 1.5, 2.0),
    "fog": _of("fog, 0..1", "weather.fog", 0.0, 0.25, 0.5, 0.75, 1.0),
    "blur": _of("blur, sigma in pixels", "weather.blur", 0.0, 1.0, 2.0, 4.0, 8.0),
    "noise": _of("noise, sigma of 255", "weather.noise", 0.0, 5.0, 10.0, 20.0, 40.0),
    "shadow": _of(LOW_SUN, "weather.sun_elevation_deg", 8.0, 15.0, 25.0, 42.0, 80.0),
    "shift": _of("camera to the right, m", "weather.camera.right_m", -0.6, -0.3, 0.0, 0.3, 0.6),
    "tilt": _of("camera tilted up, deg", "weather.camera.pitch_deg", -4.0, -2.0, 0.0, 2.0, 4.0),
    "latency": _of("latency, s", "delay_s", 0.0, 0.1, 0.2, 0.4, 0.6),
    "frame_rate": _of("frames per second", "frame_rate", 5.0, 10.0, 15.0, 20.0, 30.0),
    "speed": _of("speed, mph", "speed", 10.0, 15.0, 20.0, 25.0, 30.0),
    "offset": _of("start to the right, m", "offset", -2.0, -1.0, 0.0, 1.0, 2.0),
    "heading": _of("start pointing right, deg", "heading", -20.0, -10.0, 0.0, 10.0, 20.0),
}
PERTURBATIONS: Registry[Perturbation] = Registry("perturbation")
for _name, _perturbation in _OWN.items():
    PERTURBATIONS.add(_name, _perturbation, __name__)


def perturbation(
    label: str, *values: float, usual: float | Callable[[Scenario], float] = 0.0
) -> Callable[[Change], Change]:
    """Register the decorated function of a scenario and a value as a perturbation.

    Args:
        label: see `Perturbation`.
        *values: see `Perturbation`.
        usual: value that changes nothing, which is driven, too; or the function of a scenario that
            returns it.

    Raises:
        ValueError: there are no values, or another module has a perturbation of that name.
    """

    def register(function: Change) -> Change:
        name = function.__name__
        if not values:
            raise ValueError(f"perturbation {name}: has no values; name some in rising order")
        present = usual if callable(usual) else lambda _: float(usual)
        PERTURBATIONS.add(name, Perturbation(label, values, function, present), function.__module__)
        return function

    return register


def perturbations_named(text: str | None, throttle: str = "hold") -> list[str]:
    """Return the names in `brightness,fog`, or in `all`.

    `all` leaves out `speed` if the network controls the throttle, since then no speed is held.

    Raises:
        InputError: no perturbation has that name, or it would change nothing.
    """
    if text == "all":
        return [name for name in PERTURBATIONS if name != "speed" or throttle == "hold"]
    names = list(dict.fromkeys(text.split(","))) if text else []
    for name in names:
        if name not in PERTURBATIONS:
            raise UsageError(f"perturb={name}: no such choice; {hint(name, PERTURBATIONS)}")
        if name == "speed" and throttle != "hold":
            raise InputError("perturb=speed: throttle=network holds no speed; use throttle=hold")
    return names


def sweeps(
    names: list[str], usual: Scenario, ignores: Sequence[str] = ()
) -> dict[str, dict[float, Scenario]]:
    """Return by perturbation and value, in rising order, the scenarios; the usual one included.

    Args:
        names: names of perturbations.
        usual: scenario that they change.
        ignores: keys that change nothing in its world.

    Raises:
        InputError: a perturbation changes one of these keys.
    """
    scenarios = {}
    for name in names:
        change = PERTURBATIONS[name]
        values = sorted({*change.values, change.usual(usual)})
        with placed_errors(f"perturb={name}"):
            scenarios[name] = {value: change.apply(usual, value) for value in values}
            for scenario in scenarios[name].values():
                scenario.check_ignored(ignores)
    return scenarios


def sweep_table(results: dict[str, dict[float, dict]], usual: Scenario) -> Table:
    """Return a table with a row for each perturbation: its values, and the figures of each."""
    table = Table(short_name(usual.track), title="one quantity changed at a time; *: usual")
    for _ in range(max(map(len, results.values()))):
        table.add_column(justify="right")
    for name, by_value in results.items():
        unit = PERTURBATIONS[name].label.rpartition(", ")[2]
        normal, cells = PERTURBATIONS[name].usual(usual), []
        for value, figures in by_value.items():
            known = [(form, figures[key]) for key, form in SHOWN.items()]
            texts = ["-" if figure is None else form.format(figure) for form, figure in known]
            cells.append("\n".join([f"{value:g}{'*' if value == normal else ''}", *texts]))
        table.add_row(f"{name}, {unit}\n  autonomy\n  mean error, m", *cells)
    return table
