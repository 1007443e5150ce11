"""`key=value` options of a command: composed from its YAML by Hydra, checked by its dataclass."""

import types
from collections.abc import Sequence
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf
from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from zoo.base.errors import UsageError
from zoo.cli.conf_files import choices, conf_folder
from zoo.cli.nearest import hint

Options = TypeVar("Options")

NULLS = ("", "null", "~")
_NAMES = {float: "a number", int: "a whole number", bool: "true or false"}


def read_options(command: str, kind: type[Options], arguments: Sequence[str] = ()) -> Options:
    """Return the options of a command, with the arguments applied.

    `laps=2`, `evaluate.laps=2` and `--laps=2` mean the same; `--film` means `film=true`.

    Raises:
        UsageError: a key is unknown or repeated, or a value has the wrong type or range.
    """
    return check_options(kind, read_keys(command, arguments))


def read_keys(command: str, arguments: Sequence[str]) -> dict[str, Any]:
    """Return a command's section of its config, with the arguments applied, unchecked.

    Hydra composes the YAML files, but does not parse the typed values. In a value, blanks,
    brackets and `${...}` are therefore ordinary characters.

    Raises:
        UsageError: a key or choice is unknown, or a key is repeated.
    """
    given = _given(command, arguments)
    groups = {key: choices(f"{command}/{key}") for key in given}
    chosen = {key: given[key] for key, known in groups.items() if known}
    for key, choice in chosen.items():
        if choice not in groups[key]:
            raise UsageError(f"{key}={choice}: no such choice; {hint(choice, groups[key])}")
    config = compose_keys(command, [f"{command}/{key}={one}" for key, one in chosen.items()])
    known = _flat(config)
    for key, text in given.items():
        if key in chosen:
            continue
        if key not in known:
            remedy = f"drivezoo {command} --help lists all"
            raise UsageError(f"{key}: no such key; {hint(key, known, remedy)}")
        section = config
        *parents, last = key.split(".")
        for parent in parents:
            section = section[parent]
        section[last] = None if text in NULLS else _scalar(text) if parents else text
    return config


def compose_keys(command: str, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Return a command's section of its config, as plain containers."""
    state = GlobalHydra.instance()
    training, state.hydra = state.hydra, None  # Hydra may be in use by a training
    try:
        with initialize_config_dir(str(conf_folder().resolve()), version_base="1.3"):
            config = compose(command, list(overrides))
    finally:
        GlobalHydra.instance().hydra = training
    return OmegaConf.to_container(config, resolve=True)[command]


def check_options(kind: type[Options], settings: dict[str, Any]) -> Options:
    """Return an instance of a dataclass, with each setting converted to its field's type.

    Raises:
        UsageError: a value has the wrong type or range; the message names key, value and range.
    """
    hints = get_type_hints(kind, include_extras=True)
    values = {}
    for key, value in settings.items():
        values[key] = value
        if value is not None and not isinstance(value, str | int | float | list | dict):
            continue  # an object that the caller constructed
        try:
            values[key] = TypeAdapter(hints[key]).validate_python(value)
        except ValidationError:
            shown = "null" if value is None else value
            raise UsageError(f"{key}={shown}: must be {wanted(hints[key])}") from None
    return kind(**values)


def wanted(annotation: Any) -> str:
    """Describe the values that a field accepts.

    >>> from pydantic import Field
    >>> wanted(Annotated[float, Field(gt=0, le=1000)] | None)
    'a number above 0, up to 1000, or null'
    """
    if get_origin(annotation) in (Union, types.UnionType):
        return ", or ".join(
            "null" if one is type(None) else wanted(one) for one in get_args(annotation)
        )
    if get_origin(annotation) is Literal:
        return " or ".join(map(str, get_args(annotation)))
    if get_origin(annotation) is not Annotated:
        return _NAMES.get(annotation, "text")
    kind, *metadata = get_args(annotation)
    bounds = [one for info in metadata if isinstance(info, FieldInfo) for one in info.metadata]
    limits = {name: value for one in bounds for name, value in vars_of(one).items()}
    words = [
        f"{word} {limits[name]:g}"
        for name, word in (("gt", "above"), ("lt", "below"), ("le", "up to"))
        if name in limits
    ]
    if "ge" in limits:
        least, most = f"{limits['ge']:g}", limits.get("le", limits.get("lt"))
        words = [f"in {least}..{most:g}" if most is not None else f"of {least} or more"]
    return " ".join([wanted(kind), ", ".join(words)]).strip()


def vars_of(constraint: object) -> dict[str, float]:
    """Return the limits of one of pydantic's constraints."""
    return {
        name: getattr(constraint, name)
        for name in ("gt", "ge", "lt", "le")
        if getattr(constraint, name, None) is not None
    }


def _given(command: str, arguments: Sequence[str]) -> dict[str, str]:
    given: dict[str, str] = {}
    for argument in arguments:
        key, equals, text = argument.partition("=")
        if not equals and not argument.startswith("--"):
            raise UsageError(f"{argument}: no value given; write {argument}=VALUE")
        key = key.lstrip("-").replace("-", "_").removeprefix(f"{command}.")
        if key in given:
            raise UsageError(f"{key}: given twice; give it once")
        given[key] = text if equals else "true"
    return given


def _flat(section: dict[str, Any], prefix: str = "") -> list[str]:
    """Return the dotted keys that users can type."""
    keys = []
    for key, value in section.items():
        if isinstance(value, dict):
            keys += _flat(value, f"{prefix}{key}.")
        elif not key.startswith("_"):
            keys.append(f"{prefix}{key}")
    return keys


def _scalar(text: str) -> object:
    """Return a text as int, float or bool if it is one, for keys without a declared type."""
    for convert in (int, float):
        try:
            return convert(text)
        except ValueError:
            continue
    return {"true": True, "false": False}.get(text.lower(), text)
