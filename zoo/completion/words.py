"""The words of each command: what stands first, its keys, and the values of keys."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from simulator.__main__ import COMMANDS as SIMULATOR
from simulator.track_names import ALIASES as TRACKS
from simulator.track_names import track_names
from zoo.base.command import Command
from zoo.base.command_keys import choices_of
from zoo.base.parts import KEY
from zoo.benchmark.baselines import BASELINES
from zoo.checkpoints.checkpoint_path import LATEST, packaged_names
from zoo.cli.compose import compose_config, config_groups
from zoo.cli.conf_files import choices
from zoo.cli.config_help import typed_keys
from zoo.cli.console_script import ALIASES, GROUPS, LISTED, load, outside_commands
from zoo.new.part_files import KINDS as PART_KINDS

# Words that can stand first, by the argument's name.
FIRST = {"kind": tuple(PART_KINDS)}  # of drivezoo new
LISTS = ("augment", "callbacks")  # groups of which a user names several


@dataclass(frozen=True)
class Words:
    """The words of a command.

    Attributes:
        first: words that can stand first, besides files.
        keys: values of each key; none for a key that takes any text.
    """

    first: tuple[str, ...]
    keys: Mapping[str, tuple[str, ...]]


def command_words() -> dict[str, Words]:
    """Return the words of each command of `drivezoo`."""
    places = {name: place for group in GROUPS.values() for name, place in group.items()}
    places |= ALIASES | outside_commands()
    special = {name: Words((), _training_keys()) for name in ("train", "preview")}
    special["simulator"] = Words(tuple(SIMULATOR), {})
    found = {name: special.get(name) or words_of(load(place)) for name, place in places.items()}
    found |= {f"simulator {name}": words_of(command) for name, command in SIMULATOR.items()}
    return found | {kind: Words((), {}) for kind in LISTED}


def words_of(command: Command[Any]) -> Words:
    """Return the words of a command."""
    first: list[str] = []
    for parameter in command.arguments.values():
        first += choices_of(parameter.annotation) or FIRST.get(parameter.name, ())
        if parameter.name.removesuffix("s") == "ckpt":
            first += [LATEST, *packaged_names()]
            first += ("verify", *BASELINES) if command.name == "benchmark" else ()
    keys = {key.name: key.choices or values_of(key.name, key.typed) for key in command.keys}
    return Words(tuple(dict.fromkeys(first)), keys | ({KEY: ()} if keys and command.parts else {}))


def values_of(key: str, default: str) -> tuple[str, ...]:
    """Return the values of a key that have names, without those that only its command knows."""
    if default in ("true", "false"):
        return ("true", "false")
    checkpoints, tracks = (LATEST, *packaged_names()), tuple(sorted([*TRACKS, *track_names()]))
    names = {"ckpt": checkpoints, "weights": checkpoints, "track": tracks, "sim": tracks}
    names |= {"family": tuple(choices("road")), "suite": tuple(choices("suite"))}
    return names.get(key.rpartition(".")[2], ())


def _training_keys() -> dict[str, tuple[str, ...]]:
    groups = {name: tuple(choices(name)) for name in config_groups()}
    groups |= {name: tuple(f"[{one}]" for one in groups[name]) for name in LISTS if name in groups}
    keys = {key: values_of(key, text) for key, text in typed_keys(compose_config([]))}
    return {**groups, **keys, "resume": (), "trust": (), KEY: ()}
