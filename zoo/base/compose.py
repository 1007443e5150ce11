"""Training config from the overrides that a user types, its help, and errors in one line.

Hydra's own help would also list groups of the driver and the simulator, which share `conf`.
"""

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hydra.errors import (
    ConfigCompositionException,
    HydraException,
    MissingConfigException,
    OverrideParseException,
)
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from zoo.base.command import is_path
from zoo.base.command_keys import help_row, typed_keys
from zoo.base.conf_files import choice_files, choices, comments_of, conf_folder, trainer_arguments
from zoo.base.errors import UsageError, hint
from zoo.base.plain_files import mapped
from zoo.base.terminal import command_line

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
# Other names of choices: a network's usual name, and none where a choice adds nothing.
ALIASES = {
    ("model", "pilotnet"): "nvidia",
    ("logger", "none"): "csv",
    ("callbacks", "none"): "checkpoints",
    ("augment", "none"): "[]",
    ("schedule", "none"): "constant",
}
# Options of Hydra's that are taken, and words of other projects' commands.
SWEEPS, OWN_CHOICES = ("-m", "--multirun"), "--config-dir="
FOREIGN = {"tub": "data.root", "epochs": "trainer.max_epochs", "learning-rate": "optim.lr"}
LISTED = ("augment", "callbacks", "logger")  # groups of which several may be chosen

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
_SEVERAL = re.compile(r"Ambiguous value for argument '(?P<typed>.*)'")
_NO_OVERRIDE = re.compile(r"Could not override '(?P<key>[^'@]+)")
_NO_KEY = re.compile(r"full_key: (?P<key>\S+)|Key '(?P<short>[^']+)' is not in struct")


def hydra_overrides(arguments: Sequence[str], sweep: bool = False) -> list[str]:
    r"""Return overrides as Hydra reads them, from what a user types.

    Paths are quoted, so that Hydra does not parse them. It still interpolates `${...}`, unless a
    file or folder has exactly that name; it never interpolates `\${...}`. Other names of choices
    are replaced, and any argument of Lightning's Trainer is a key of `trainer`.

    >>> hydra_overrides(["data.root=a=b", "model=pilotnet", "data=my laps/", "trainer.max_steps=9"])
    ["data.root='a=b'", 'model=nvidia', "data.root='my laps/'", '++trainer.max_steps=9']

    Args:
        arguments: overrides as typed.
        sweep: whether a comma separates the values of a sweep.

    Raises:
        UsageError: an option is not one of drivezoo's, or a key is given twice.
    """
    refuse_repeated(arguments)
    return [_hydra_override(argument, sweep) for argument in arguments]


def _hydra_override(argument: str, sweep: bool) -> str:
    typed, equals, value = argument.partition("=")
    if typed.startswith("-"):
        return _searched(argument)
    key = typed.lstrip("+")
    if not equals:
        return argument
    names = value.split(",") if sweep else [value]
    if key == "data" and not {*names} <= {*choices(key)} and any(map(_names_folder, names)):
        key = typed = "data.root"
    elif key in config_groups() and not value.startswith("{"):
        if value.startswith("[") and key not in LISTED:
            raise UsageError(f"{argument}: takes one name; drivezoo train -m takes a,b,c")
        return f"{key}={','.join(ALIASES.get((key, name), name) for name in names)}"
    if key in PATH_KEYS:
        value = _quote_value(value, sweep)
    if key.startswith("hydra") or not {*"@/"}.isdisjoint(key):
        return f"{typed}={value}"
    section = key.partition(".")[0]
    is_added = typed != key and section in config_groups()  # others Hydra finds to be no key
    is_added |= key == "callbacks" or (section == "trainer" and key in _trainer_keys())
    return f"++{key}={value}" if is_added else f"{key}={value}"  # ++ adds a key, or replaces it


def _trainer_keys() -> list[str]:
    """Return the keys of `trainer` that no YAML file has, but Lightning."""
    return [f"trainer.{name}" for name in trainer_arguments()]


def _names_folder(value: str) -> bool:
    return is_path(value) or "/" in value or os.sep in value


def _searched(option: str) -> str:
    """Return the override that searches the folder of `--config-dir=` for choices."""
    if option.startswith(OWN_CHOICES):
        return f"hydra.searchpath=[{quote(f'file://{option.removeprefix(OWN_CHOICES)}')}]"
    if option in SWEEPS:
        return option
    name = option.lstrip("-").partition("=")[0]
    keys = [FOREIGN[name]] if name in FOREIGN else valid_keys()
    near = hint(FOREIGN.get(name, name.replace("-", "_")), keys, LISTS_ALL)
    raise UsageError(f"{option}: no such option; type key=value, such as seed=2: {near}")


def refuse_repeated(arguments: Iterable[str]) -> None:
    """Raise UsageError for a key that is given twice; Lightning repeats Hydra's in its ranks."""
    seen = set()
    for argument in arguments:
        key = argument.lstrip("+").partition("=")[0]
        if "=" in argument and key in seen and not key.startswith("hydra."):
            raise UsageError(f"{key}: given twice; give it once")
        seen.add(key)


def plain_dict(config: DictConfig, resolve: bool = True) -> dict[str, Any]:
    """Return a config as plain containers, with its interpolations resolved."""
    container: Any = OmegaConf.to_container(config, resolve=resolve)
    return dict(container)


def escape_interpolation(value: Any) -> Any:
    r"""Escape `${...}` in a value, or in all values of a container, for OmegaConf.

    >>> escape_interpolation(["a${b}", 1])
    ['a\\${b}', 1]
    """
    return mapped(
        lambda raw: re.sub(r"(\\*)\$\{", r"\1\1\\${", raw) if isinstance(raw, str) else raw, value
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
        return f"[{','.join(_quote_value(path, False) for path in _paths_in(value[1:-1]))}]"
    if sweep and re.match(r"\w+\(", value):  # choice(...), glob(...)
        return value
    if sweep and "," in value:
        return ",".join(_quote_value(path, sweep) for path in _paths_in(value))
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
    return [path for path in paths if path]


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
        for word in arguments:  # null, true or a number is no name of a choice
            group, _, value = word.partition("=")
            if (names := choices(group)) and value not in names and value[:1] != "[":
                what = f"name a choice; available: {', '.join(names)}"
                raise UsageError(f"{word}: {what}") from error
        raise


def _explained(error: Exception, arguments: Sequence[str]) -> str:
    """Return one line for an error of Hydra, with the nearest valid key or choice."""
    text = str(error)
    if isinstance(error, OverrideParseException) and "=" in error.override:
        return f"{error.override}: cannot be read; close its brackets and quotes"
    if several := _SEVERAL.search(text):
        key, _, value = several["typed"].partition("=")
        return (
            f"{key}={value}: names several values; drivezoo train -m trains with each; or type "
            f"'{key}=[{value}]' for a list, and a decimal number with a point"
        )
    if isinstance(error, MissingConfigException) and error.missing_cfg_file:
        group, _, choice = str(error.missing_cfg_file).rpartition("/")
        file = Path("conf", group, f"{choice}.yaml")
        if group and file.is_file():  # the folder of a user's part, which the user has not named
            return f"{group}={choice}: no such choice; for {file} add parts=FILE.py"
        if group:
            return f"{group}={choice}: no such choice; {hint(choice, choices(group), LISTS_ALL)}"
    match = _NO_OVERRIDE.search(text)
    if isinstance(error, ConfigCompositionException) and not match:
        match = _NO_KEY.search(f"{text} {error.__cause__}")
    key = None
    if match:
        key = next(value for value in match.groupdict().values() if value)
    elif isinstance(error, ConfigAttributeError | ConfigKeyError):
        key = error.full_key
    if key and key in valid_keys():
        return f"{key}: belongs to a part that is not chosen; {LISTS_ALL}"
    if key:
        return f"{key}: no such key; {hint(key, valid_keys(), LISTS_ALL)}"
    for argument in arguments:
        if "=" not in argument and not argument.startswith(("-", "~")):
            return f"{argument}: expected key=value, such as data.root={argument}; {LISTS_ALL}"
    first = text.strip().splitlines()[0] if text.strip() else type(error).__name__
    return f"{first} (in: {' '.join(arguments)}); {LISTS_ALL}"


def valid_keys() -> list[str]:
    """Return every key that users can type, including groups, `parts`, `resume` and `trust`."""
    keys = ["parts", "resume", "trust", *config_groups()]
    keys += _trainer_keys()

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


def compose_config(overrides: list[str]) -> dict[str, Any]:
    """Return the config of `drivezoo train *overrides` as plain containers."""
    return compose_with_choices(overrides)[0]


def compose_with_choices(
    overrides: list[str],
) -> tuple[dict[str, Any], dict[str, str | None]]:
    """Return the config of `drivezoo train *overrides`, and the chosen name of each group."""
    from hydra import compose, initialize_config_dir

    conf = initialize_config_dir(str(conf_folder().resolve()), version_base="1.3")
    with one_line_errors(overrides), conf:
        composed = compose("config", overrides, return_hydra_config=True)
        config = OmegaConf.masked_copy(composed, [str(key) for key in composed if key != "hydra"])
        return plain_dict(config), plain_dict(composed.hydra.runtime.choices)


def config_help(arguments: Sequence[str]) -> str:
    """Return the help, with the config that the arguments' overrides compose."""
    overrides = [
        argument
        for argument in arguments
        if not argument.startswith(("-", "resume=", "trust=", "hydra"))
    ]
    config, chosen = compose_with_choices(hydra_overrides(overrides))
    groups = [f"{name}: {', '.join(choices(name))}" for name in config_groups()]
    meanings = key_comments(chosen)
    keys = [
        help_row(command_line([f"{key}={value}"]), meanings.get(key, ""), NAMES)
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
        paths, preferred = choice_files(group), chosen.get(group)
        names = [*(name for name in sorted(paths) if name != preferred), preferred]
        files += [(group, paths[name]) for name in names if name in paths]
    comments: dict[str, str] = {}
    for package, path in [*files, ("", conf_folder() / "config.yaml")]:
        text = path.read_text(encoding="utf-8")
        header = _PACKAGE.match(text)
        comments |= comments_of(text, f"{header['package'] if header else package}.".lstrip("."))
    return comments
