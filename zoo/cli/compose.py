"""Training config from the overrides that a user types, its help, and errors in one line.

Hydra's own help would also list groups of the driver and the simulator, which share `conf`.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hydra.errors import ConfigCompositionException, HydraException, MissingConfigException
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from zoo.base.bounded_files import mapped
from zoo.base.command import is_path
from zoo.base.command_keys import help_row, typed_keys
from zoo.base.errors import UsageError, hint
from zoo.cli.conf_files import choice_files, choices, comments_of, conf_folder

# Keys whose values are paths; in a path, Hydra's grammar has no meaning except `${...}`.
PATH_KEYS = (
    "data.root",
    "data.images",
    "data.cache",
    "data.split",
    "data.record.out",
    "model.weights",
    "hydra.run.dir",
    "hydra.sweep.dir",
)
LISTS_ALL = "drivezoo train --help lists all"
NO_PATHS = ("", "null", "true", "false")

# Groups in `conf` that are not part of the training config: driver, simulator, Hydra.
OTHER_GROUPS = ("drive", "environment", "road", "suite", "track", "world", "hydra")

ABOUT = """usage: drivezoo train [key=value...]

Trains, tests and reports one experiment; with -m, a sweep.

  drivezoo train experiment=first_try data.root=FOLDER    train a network that drives, in minutes
  drivezoo train data.root=FOLDER                         train nvidia on a recording
  drivezoo train experiment=tiny41 data.root=FOLDER       train by a published recipe
  drivezoo train seeds=5 data.root=FOLDER                 train with the seeds 1 to 5
  drivezoo train -m model=lenet,nvidia data.root=FOLDER   train a sweep of two runs
  drivezoo train resume=FOLDER                            resume a run or a sweep that was stopped
  drivezoo train rerun=RUN_FOLDER                         repeat a run and compare the figures
    trust=my.module.Class                                allow its config to name your own class
  drivezoo train parts=my_net.py model=my_net             train a network of your own file
  drivezoo train model=tiny --help                        show the keys and values of model=tiny

See also: drivezoo models (networks), preview (what a network is fed), check (a recording)."""

NAMES = 36  # characters of the first column: these keys are long

_PACKAGE = re.compile(r"# @package (?P<package>[\w.]+)")
_NO_OVERRIDE = re.compile(r"Could not override '(?P<key>[^'@]+)")
_NO_KEY = re.compile(r"full_key: (?P<key>\S+)|Key '(?P<short>[^']+)' is not in struct")


def quote_paths(arguments: list[str], sweep: bool = False) -> list[str]:
    r"""Quote the values of keys that take a path, so that Hydra does not parse them.

    Hydra still interpolates `${...}`, unless a file or folder has exactly that name. It never
    interpolates `\${...}`.

    >>> quote_paths(["data.root=a=b", "data.root=[my laps,b]", "seed=1"])
    ["data.root='a=b'", "data.root=['my laps','b']", 'seed=1']

    Args:
        arguments: overrides as typed.
        sweep: whether a comma separates the values of a sweep.
    """
    quoted = []
    for argument in arguments:
        key, equals, value = argument.partition("=")
        if equals and key.lstrip("+") in PATH_KEYS:
            argument = f"{key}={_quote_value(value, sweep)}"
        elif key.startswith("+callbacks.") or (key == "callbacks" and value.startswith("{")):
            # `++` adds a callback, or replaces the one of that name.
            argument = f"++{argument.lstrip('+')}"
        quoted.append(argument)
    return quoted


def escape_interpolation(value: Any) -> Any:
    r"""Escape `${...}` in a value, or in all values of a container, for OmegaConf.

    >>> escape_interpolation(["a${b}", 1])
    ['a\\${b}', 1]
    """
    return mapped(
        lambda one: re.sub(r"(\\*)\$\{", r"\1\1\\${", one) if isinstance(one, str) else one, value
    )


def quote(value: str) -> str:
    """Quote a text for Hydra's parser."""
    escaped = re.sub(r"(\\*)('|$)", lambda m: 2 * m[1] + (m[2] and "\\'"), value)
    return f"'{escaped}'"


def _quote_value(value: str, sweep: bool) -> str:
    if is_path(value):
        return quote(escape_interpolation(value))
    for parent in map(str, Path(value).parents):  # the path itself does not exist yet
        if "${" in parent and is_path(parent) and value.startswith(parent):
            return quote(escape_interpolation(parent) + value[len(parent) :])
    if value.lower() in NO_PATHS:
        return value
    if len(value) > 1 and value[0] == value[-1] and value[0] in "'\"":
        # Lightning quotes the run's folder for the ranks that it starts, without escaping it.
        inner = value[1:-1]
        return quote(escape_interpolation(inner)) if is_path(inner) else value
    if value[0] == "[" and value[-1] == "]":
        return f"[{','.join(_quote_value(one, False) for one in _paths_in(value[1:-1]))}]"
    if sweep and re.match(r"\w+\(", value):  # choice(...), glob(...)
        return value
    if sweep and "," in value:
        return ",".join(_quote_value(one, sweep) for one in _paths_in(value))
    return quote(value)


def _paths_in(text: str) -> list[str]:
    """Split a text at commas, except at those in quotes, in brackets or in an existing path."""
    parts = text.split(",")
    paths = []
    while parts:
        for count in range(len(parts), 1, -1):
            joined = ",".join(parts[:count]).strip()
            inside = joined[:1] + joined[-1:] in ("''", '""', "[]")
            if is_path(joined) or (inside and joined[0] not in ",".join(parts[1:count])[:-1]):
                break
        else:
            count, joined = 1, parts[0].strip()
        paths.append(joined)
        parts = parts[count:]
    return [one for one in paths if one]


@contextmanager
def one_line_errors(arguments: Sequence[str]) -> Iterator[None]:
    """Raise UsageError for an error of Hydra or OmegaConf within the block.

    Args:
        arguments: overrides as typed.
    """
    try:
        yield
    except (HydraException, OmegaConfBaseException) as error:
        raise UsageError(_explained(error, arguments)) from error
    except ValueError as error:
        if not str(error).startswith("Config group override"):
            raise
        nulls = " ".join(word for word in arguments if word.endswith("=null"))  # callbacks=null
        raise UsageError(f"{nulls}: name a choice; {LISTS_ALL}") from error


def _explained(error: Exception, arguments: Sequence[str]) -> str:
    """Return one line for an error of Hydra, with the nearest valid key or choice."""
    text = str(error)
    if isinstance(error, MissingConfigException) and error.missing_cfg_file:
        group, _, choice = str(error.missing_cfg_file).rpartition("/")
        own = Path("conf", group, f"{choice}.yaml")
        if group and own.is_file():  # the folder of a user's part, which the user has not named
            return f"{group}={choice}: no such choice; for {own} add parts=FILE.py"
        if group:
            return f"{group}={choice}: no such choice; {hint(choice, choices(group), LISTS_ALL)}"
    found = _NO_OVERRIDE.search(text)
    if isinstance(error, ConfigCompositionException) and not found:
        found = _NO_KEY.search(f"{text} {error.__cause__}")
    key = None
    if found:
        key = next(value for value in found.groupdict().values() if value)
    elif isinstance(error, ConfigAttributeError | ConfigKeyError):
        key = error.full_key
    if key and key in valid_keys():
        return f"{key}: belongs to a part that is not chosen; {LISTS_ALL}"
    if key:
        return f"{key}: no such key; {hint(key, valid_keys(), LISTS_ALL)}"
    for one in arguments:
        if "=" not in one and not one.startswith(("-", "~")):
            return f"{one}: expected key=value, such as data.root={one}; {LISTS_ALL}"
    first = text.strip().splitlines()[0] if text.strip() else type(error).__name__
    return f"{first} (in: {' '.join(arguments)}); {LISTS_ALL}"


def valid_keys() -> list[str]:
    """Return every key that users can type, including groups, `parts`, `resume` and `trust`."""
    keys = ["parts", "resume", "trust", *config_groups()]

    def walk(node: dict, prefix: str = "") -> None:
        for key, value in node.items():
            keys.append(f"{prefix}{key}")
            if isinstance(value, dict):
                walk(value, f"{prefix}{key}.")

    walk(compose_config([]))
    return list(dict.fromkeys(keys))


def config_groups() -> list[str]:
    """Return the names of the groups in the training config."""
    folders = sorted(path.name for path in conf_folder().iterdir() if path.is_dir())
    return [name for name in folders if name not in OTHER_GROUPS]


def compose_config(overrides: list[str]) -> dict:
    """Return the config of `drivezoo train *overrides` as plain containers."""
    return compose_with_choices(overrides)[0]


def compose_with_choices(overrides: list[str]) -> tuple[dict, dict[str, str | None]]:
    """Return the config of `drivezoo train *overrides`, and the chosen name of each group."""
    from hydra import compose, initialize_config_dir
    from omegaconf import OmegaConf

    conf = initialize_config_dir(str(conf_folder().resolve()), version_base="1.3")
    with one_line_errors(overrides), conf:
        composed = compose("config", overrides, return_hydra_config=True)
        chosen = OmegaConf.to_container(composed.hydra.runtime.choices)
        config = OmegaConf.masked_copy(composed, [key for key in composed if key != "hydra"])
        return OmegaConf.to_container(config, resolve=True), chosen


def config_help(arguments: Sequence[str]) -> str:
    """Return the help, with the config that the arguments' overrides compose."""
    overrides = [
        one for one in arguments if not one.startswith(("-", "resume=", "trust=", "hydra"))
    ]
    config, chosen = compose_with_choices(quote_paths(overrides))
    groups = [f"{name}: {', '.join(choices(name))}" for name in config_groups()]
    meanings = key_comments(chosen)
    keys = [
        help_row(f"{key}={value}", meanings.get(key, ""), NAMES)
        for key, value in typed_keys(config)
        if "._" not in key  # `_target_`, which the choices decide
    ]
    return "\n".join([ABOUT, "", "Choices, name=choice", *groups, "", "Keys, key=value", *keys])


def key_comments(chosen: Mapping[str, str | None]) -> dict[str, str]:
    """Return the comment of each key in the YAML files; chosen files have priority.

    A key that the chosen file leaves without a comment has that of another file of its group.
    """
    files = [("score", conf_folder() / "world" / "embedded.yaml")]
    for group in config_groups():
        names = sorted(choices(group), key=lambda name, group=group: name == chosen.get(group))
        paths = choice_files(group)
        files += [(group, paths[name]) for name in names]
    found = {}
    for package, path in [*files, ("", conf_folder() / "config.yaml")]:
        text = path.read_text(encoding="utf-8")
        header = _PACKAGE.match(text)
        prefix = f"{header['package'] if header else package}.".lstrip(".")
        found |= comments_of(text, prefix)
    return found
