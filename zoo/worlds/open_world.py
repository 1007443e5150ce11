"""The worlds that a scenario can name: those of this project, and those of installed packages."""

from collections.abc import Callable

from zoo.base.errors import InputError
from zoo.cli.nearest import hint
from zoo.worlds.scenario import Scenario
from zoo.worlds.world import World

GROUP = "drivezoo.worlds"  # of the entry points


def _embedded(scenario: Scenario, renderer: str) -> World:
    from zoo.worlds.embedded_world import open_embedded

    return open_embedded(scenario, renderer)


def _replay(scenario: Scenario, renderer: str) -> World:
    from datamodules.recording import read_recordings
    from zoo.worlds.replay_world import ReplayWorld

    return ReplayWorld(read_recordings(scenario.track))


def _gymnasium(scenario: Scenario, renderer: str) -> World:
    from zoo.worlds.environment_world import make_environment

    return make_environment(scenario)


OPENERS: dict[str, Callable[[Scenario, str], World]] = {
    "embedded": _embedded,
    "replay": _replay,
    "gymnasium": _gymnasium,
}


def open_world(scenario: Scenario, renderer: str = "auto") -> World:
    """Open the world of a scenario.

    Args:
        scenario: drive for which the world is opened.
        renderer: auto, software or none, for a world that renders.

    Raises:
        InputError: there is no such world, or it cannot be opened.
    """
    if scenario.world in OPENERS:
        return OPENERS[scenario.world](scenario, renderer)
    from importlib.metadata import entry_points  # slow import

    installed = {point.name: point for point in entry_points(group=GROUP)}
    if scenario.world not in installed:
        known = [*OPENERS, *installed]
        raise InputError(f"world={scenario.world}: no such world; {hint(scenario.world, known)}")
    return installed[scenario.world].load()(scenario, renderer)
