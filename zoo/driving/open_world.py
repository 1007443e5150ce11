"""The worlds that a scenario can name: those of drivezoo, of extras, parts and packages."""

from collections.abc import Callable

from zoo.base.errors import InputError, UsageError, hint
from zoo.base.registry import Registry
from zoo.driving.scenario import Scenario
from zoo.driving.world import World


def _embedded(scenario: Scenario, renderer: str) -> World:
    from zoo.driving.embedded_world import open_embedded

    return open_embedded(scenario, renderer)


def _replay(scenario: Scenario, renderer: str) -> World:
    from datamodules.recording_format import read_recordings
    from zoo.driving.replay_world import ReplayWorld

    return ReplayWorld(read_recordings(scenario.track))


Opener = Callable[[Scenario, str], World]
WORLDS: Registry[Opener] = Registry("world")
WORLDS.add("embedded", _embedded, __name__)
WORLDS.add("replay", _replay, __name__)


def world(name: str) -> Callable[[Opener], Opener]:
    """Register the decorated class, or function that returns a world, under a name.

    Args:
        name: what `Scenario.world` names.

    Raises:
        ValueError: another module has registered a world of that name.
    """

    def register(opener: Opener) -> Opener:
        WORLDS.add(name, opener, opener.__module__)
        return opener

    return register


def open_world(scenario: Scenario, renderer: str = "auto") -> World:
    """Open the world of a scenario.

    Args:
        scenario: drive for which the world is opened.
        renderer: auto, software or none, for a world that renders.

    Raises:
        InputError: it cannot be opened.
        UsageError: there is no such world, or it ignores a key of the scenario.
    """
    if scenario.world not in WORLDS:
        raise UsageError(f"world={scenario.world}: no such world; {hint(scenario.world, WORLDS)}")
    opened = WORLDS[scenario.world](scenario, renderer)
    try:
        scenario.check_ignored(opened.ignores)
    except InputError:
        opened.close()
        raise
    return opened
