"""The words of each command: what stands first, its keys, and the values of keys."""

import importlib
import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from types import ModuleType

import simulator.__main__ as simulator_commands
from simulator.track_names import ALIASES, track_names
from zoo.benchmark.baselines import BASELINES
from zoo.checkpoints.checkpoint_path import LATEST, packaged_names
from zoo.cli.compose import compose_config, config_groups
from zoo.cli.conf_files import choices, command_keys
from zoo.cli.config_help import typed_keys
from zoo.cli.console_script import LISTED, commands
from zoo.cli.parts import KEY
from zoo.hub.hub_options import PULL, PUSH
from zoo.list import KINDS as LIST_KINDS
from zoo.new.part_files import KINDS as PART_KINDS

SHELLS = ("bash", "zsh", "fish")
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
    found = {name: Words(_first(name, module), _keys(name)) for name, module in commands().items()}
    training = _training_keys()
    for name in ("train", "preview"):
        found[name] = Words((), training)
    for name in simulator_commands.COMMANDS:
        found[f"simulator {name}"] = Words((), _simulator_keys(name))
    return found | {kind: Words((), {}) for kind in LISTED}


def _first(name: str, module: str) -> tuple[str, ...]:
    known = {
        "benchmark": ("verify", *BASELINES),
        "completion": SHELLS,
        "hub": (PUSH, PULL),
        "list": tuple(dict.fromkeys([*LIST_KINDS, *LISTED])),
        "new": tuple(PART_KINDS),
        "simulator": tuple(simulator_commands.COMMANDS),
    }
    return (*known.get(name, ()), *((LATEST, *packaged_names()) if _takes(name, module) else ()))


def _takes(name: str, module: str) -> bool:
    """Return whether a command's first argument is a checkpoint."""
    if name in ("train", "check", "simulator"):
        return False
    place = importlib.util.find_spec(module)
    package = place is not None and place.submodule_search_locations is not None
    loaded = importlib.import_module(f"{module}.__main__" if package else module)
    arguments = getattr(loaded, "COMMAND", None)
    return any("CKPT" in one for one in arguments.arguments) if arguments else False


def _keys(command: str) -> dict[str, tuple[str, ...]]:
    keys = command_keys(command)
    found = {}
    for one in keys:
        values = tuple(choices(f"{command}/{one.name}")) or values_of(one.name, one.default)
        found[one.name] = values
    return found | ({KEY: ()} if keys else {})


def values_of(key: str, default: str) -> tuple[str, ...]:
    """Return the values of a key that have names, without those that only its command knows."""
    if default in ("true", "false"):
        return ("true", "false")
    names = {
        "ckpt": (LATEST, *packaged_names()),
        "family": tuple(choices("road")),
        "suite": tuple(choices("suite")),
        "weights": (LATEST, *packaged_names()),
    }
    last = key.rpartition(".")[2]
    return (
        tuple(sorted([*ALIASES, *track_names()]))
        if last in ("track", "sim")
        else names.get(last, ())
    )


def _training_keys() -> dict[str, tuple[str, ...]]:
    groups = {name: tuple(choices(name)) for name in config_groups()}
    groups |= {name: tuple(f"[{one}]" for one in groups[name]) for name in LISTS if name in groups}
    keys = {key: values_of(key, text) for key, text in typed_keys(compose_config([]))}
    return {**groups, **keys, "resume": (), "trust": (), KEY: ()}


def _simulator_keys(name: str) -> dict[str, tuple[str, ...]]:
    module: ModuleType = importlib.import_module(f"simulator.{name}")
    kind = next(
        one for text, one in vars(module).items() if text.endswith("Options") and is_dataclass(one)
    )
    return {one.name: values_of(one.name, str(one.default).lower()) for one in fields(kind)}
