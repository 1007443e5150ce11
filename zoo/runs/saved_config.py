"""Check configs that were read from a file, which may come from an untrusted person.

Hydra calls any function that a `_target_` names. A config that the user typed, or that the package
contains, may name any. A config from a run's folder or a checkpoint may name only classes by a
rule for each section, and no other module is imported. (Hydra's own blocklist is not a
security boundary, as its source says.) It may also name classes of the parts that the user names
or has installed (see `zoo.base.parts`), if they are of the section's kind.

A saved config still decides which recording and weights are read, where decoded views are cached
(`data.cache`), and how much time, memory and how many processes a run takes.
"""

import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import yaml
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from zoo.base.errors import InputError, UsageError
from zoo.base.new_folder import RECIPE
from zoo.base.parts import unknown_part
from zoo.base.plain_files import leaves
from zoo.runs.allowed_classes import is_allowed

TRUST = "trust"  # key with which the user allows more

Keys = tuple[str, ...]

# Sections whose classes write files; the files must lie in the run's folder.
WRITERS = ("callbacks", "logger")
READ_KEYS = ("track",)  # keys of these sections that name files to read
FOLDER_KEYS = ("save_dir", "root_dir")  # of loggers; a run sets them to its own folder
# Keys of the trainer that write elsewhere, or replace what a run sets.
TRAINER_KEYS = ("callbacks", "default_root_dir", "logger", "plugins", "profiler")
STRATEGIES = re.compile(r"auto|single_device|ddp\w*|fsdp\w*")
# Limits of numbers that take processes or memory before the training shows any progress.
MOST: dict[Keys, int] = {
    ("trainer", "devices"): 64,
    ("trainer", "num_nodes"): 64,
    ("data", "workers"): 64,
    ("data", "batch_size"): 1_000_000,
    ("data", "samples_per_epoch"): 1_000_000_000,
    ("model", "size"): 4096,  # height and width of the view
}
RECORDINGS = "outputs"  # a saved config's data.record.out must lie below it
_INTERPOLATION = re.compile(r"(?<!\\)(?:\\\\)*(\$\{)")
_PLAIN = re.compile(r"\$\{[\w.\[\]]+\}")


@dataclass(frozen=True)
class Refusal:
    """A value that a saved config must not have.

    Attributes:
        key: its key, with dots.
        value: refused value.
        reason: text on why it is refused.
        trust: name that the user adds to `trust=` to allow it.
    """

    key: str
    value: object
    reason: str
    trust: str


def split_trust(arguments: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Return the arguments without `trust=...`, and the names in it.

    >>> split_trust(["seed=2", "trust=my.Loss,trainer.profiler"])
    (['seed=2'], ('my.Loss', 'trainer.profiler'))
    """
    words = [argument for argument in arguments if argument.startswith(f"{TRUST}=")]
    names = [name.strip() for word in words for name in word.partition("=")[2].split(",")]
    return [argument for argument in arguments if argument not in words], tuple(filter(None, names))


def check_saved_config(
    config: DictConfig | Mapping,
    source: object,
    trusted: Collection[str] = (),
    typed: Collection[Keys] = (),
) -> None:
    """Refuse a config that could run other code or write elsewhere than a normal run.

    Args:
        config: whole config, as it will be used.
        source: file of the config, for the message.
        trusted: names of classes and keys that the user allows.
        typed: keys whose values the user typed; these may have any value.

    Raises:
        InputError: a value is refused (see `find_refusals`), or an interpolation cannot be
            resolved.
    """
    for refusal in find_refusals(config, source, trusted, typed):
        parts = "parts= and its file, or " if refusal.key.endswith("._target_") else ""
        remedy = f"if you trust it, add {parts}{TRUST}={refusal.trust:.200}"
        if refusal.key == "model._target_" and not str(refusal.value).startswith("zoo."):
            # `make_network` takes no network of another module, trusted or not.
            remedy = unknown_part(refusal.value)
        raise InputError(
            f"{source}: {refusal.key}={refusal.value!r:.200} {refusal.reason}, so nothing was "
            f"run; {remedy}"
        )


def find_refusals(
    config: DictConfig | Mapping,
    source: object = "the config",
    trusted: Collection[str] = (),
    typed: Collection[Keys] = (),
) -> Iterator[Refusal]:
    """Yield the values that a saved config must not have.

    The rules: a `_target_` contains no interpolation and names a class that its section allows, see
    `zoo.runs.allowed_classes`; an interpolation names another key; callbacks, loggers and the
    trainer write only in the run's folder; a recording that is made on first use lies below
    `outputs`. The constants of this file name the keys.
    """
    if not isinstance(config, DictConfig):
        config = OmegaConf.create(dict(config))
    refused = False
    for keys, value in leaves(OmegaConf.to_container(config, resolve=False)):
        key = ".".join(keys)
        if keys in typed or key in trusted or not isinstance(value, str):
            continue
        if keys[-1:] == ("_target_",) and _INTERPOLATION.search(value):
            refused = True
            yield Refusal(key, value, "contains an interpolation", key)
        elif _calls_resolver(value):
            refused = True
            yield Refusal(key, value, "runs a function when it is resolved", key)
    if refused:  # resolving would run it
        return
    try:
        plain: Any = OmegaConf.to_container(config, resolve=True)
    except (OmegaConfBaseException, RecursionError) as error:
        raise InputError(
            f"{source}: an interpolation cannot be resolved ({_line(error)}); correct it"
        ) from None
    for keys, value in leaves(plain):
        reason, name = _refused(keys, value, plain)
        if reason and keys not in typed and not {name, ".".join(keys)} & set(trusted):
            yield Refusal(".".join(keys), value, reason, name)


def leaf_keys(value: object, keys: Keys = ()) -> set[Keys]:
    """Return the keys of all values within a value."""
    if OmegaConf.is_config(value):
        value = OmegaConf.to_container(value, resolve=False)
    return {leaf for leaf, _ in leaves(value, keys)}


def overridden(saved: DictConfig, overrides: list[str]) -> tuple[DictConfig, set[Keys]]:
    """Return a copy of a config with overrides as Hydra reads them, and the keys that they set.

    Raises:
        UsageError: an override cannot be read, names no key or several values, or chooses a part.
    """
    from hydra.core.override_parser.overrides_parser import OverridesParser

    from zoo.base.compose import config_groups, hydra_overrides, one_line_errors

    config, typed = saved.copy(), set()
    OmegaConf.set_struct(config, True)
    with one_line_errors(overrides):
        for change in OverridesParser.create().parse_overrides(hydra_overrides(overrides)):
            key, line = change.key_or_group, change.input_line
            if key in config_groups():
                raise UsageError(
                    f"{line}: a resumed run keeps its config groups; set single values, such as "
                    "trainer.max_epochs=60, or start a new run"
                )
            if change.is_sweep_override():
                raise UsageError(f"{line}: is a sweep; give one value")
            value = None if change.is_delete() else change.value()
            OmegaConf.update(config, key, value, force_add=change.is_add() or change.is_force_add())
            typed |= leaf_keys(value, tuple(re.split(r"[.\[\]]+", key)))
    OmegaConf.set_struct(config, False)
    return config, typed


def _refused(keys: Keys, value: Any, config: Mapping) -> tuple[str | None, str]:
    """Return why a value is refused, or None; and the name for `trust=`."""
    key, section = ".".join(keys), keys[0] if keys else ""
    if keys[-1:] == ("_target_",):
        is_known = is_allowed(keys[:-1], value) or _is_shipped(keys[:-1], config)
        return None if is_known else "is not a class that a saved config may name here", str(value)
    if section in WRITERS and not _is_shipped(keys[:2], config):
        if section == "logger" and keys[-1] in FOLDER_KEYS and value is not None:
            return "lets a logger write outside the run's folder", key
        is_text = isinstance(value, str | bytes | os.PathLike) and keys[-1] not in READ_KEYS
        if is_text and _leads_out(os.fsdecode(value)):
            return "leads out of the run's folder", key
    limited = keys[:-1] if keys[:-1] in MOST else keys  # a list's items have its limit
    if (most := MOST.get(limited)) and _exceeds(value, most):
        return f"is above {most:,}, the limit of a saved config", key
    if section == "trainer":
        if len(keys) > 1 and keys[1] in TRAINER_KEYS and value not in (None, False):
            return "is a trainer's key that a saved config may not set", key
        if keys == ("trainer", "strategy") and not STRATEGIES.fullmatch(str(value)):
            return "is not a strategy that a saved config may name", key
    if keys == ("data", "record", "out") and config["data"].get("root") is None:
        path = PurePath(str(value))
        below = not _leads_out(str(value)) and path.parts[:1] == (RECORDINGS,)
        if not below and not (Path(path) / RECIPE).is_file():
            return f"would record outside of {RECORDINGS}/", key
    return None, key


def _exceeds(value: Any, most: int) -> bool:
    """Return whether a number, or a text that Lightning reads as one, is above a limit.

    >>> [_exceeds(n, 64) for n in (64, 65, "65", 1e300, True, "auto", -1, "0,1", None)]
    [False, True, True, True, False, False, False, False, False]
    """
    try:
        return float(value) > most
    except OverflowError:
        return True
    except (TypeError, ValueError):  # a list, a word
        return False


def _is_shipped(place: Keys, config: Mapping) -> bool:
    """Return whether a logger's section is equal to one of the package's YAML files."""
    if len(place) != 2 or place[0] != "logger":
        return False
    from zoo.base.compose import choices, conf_folder

    name = place[1]
    if name not in choices("logger"):
        return False
    shipped = yaml.safe_load(
        (conf_folder() / "logger" / f"{name}.yaml").read_text(encoding="utf-8")
    )
    return bool(shipped.get(name) == config["logger"][name])


def _calls_resolver(text: str) -> bool:
    r"""Return whether a text has an interpolation that is more than another key's name.

    >>> [_calls_resolver(text) for text in ("${trainer.max_epochs}", "${oc.env:HOME}", r"\${a:b}")]
    [False, True, False]
    """
    return any(not _PLAIN.match(text, match.start(1)) for match in _INTERPOLATION.finditer(text))


def _leads_out(value: str) -> bool:
    path = PurePath(value.replace("\\", "/"))
    drive = re.match(r"[A-Za-z]:", value)
    return path.is_absolute() or ".." in path.parts or ":/" in value or drive is not None


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
