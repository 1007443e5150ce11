"""YAML files of `conf`: their folder, the choices of each group, and the keys in a file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from zoo.base.errors import InputError
from zoo.base.parts import named_parts

_LINE = re.compile(r"(?P<indent> *)(?P<key>\w+):(?P<value>[^#]*)(?:#\s*(?P<comment>.*))?$")


@dataclass(frozen=True)
class Key:
    """A key in a YAML file.

    Attributes:
        name: dotted key that a user types before `=`.
        default: default value as a user types it.
        comment: meaning, unit and range.
    """

    name: str
    default: str
    comment: str


def conf_folder() -> Path:
    """Return the folder of the YAML files."""
    return shipped_folder("conf")


def is_conf_folder(folder: Path) -> bool:
    """Return whether a folder is `conf_folder()`, as `conf` is in a checkout."""
    return folder.is_dir() and folder.samefile(conf_folder())


def shipped_folder(name: str) -> Path:
    """Return a folder of the checkout's top, which an installed package has inside."""
    package = Path(__file__).parents[1]
    installed = package / name
    return installed if installed.is_dir() else package.parent / name


def part_folders() -> list[Path]:
    """Return the folders of the YAML files of the user's parts.

    drivezoo's own files come first. One of the same name in an installed package is not used.

    Raises:
        InputError: a file's part has a YAML file of the same group and name as drivezoo.
    """
    parts = [one for one in named_parts() if one.conf and not is_conf_folder(one.conf)]
    for folder in dict.fromkeys(one.conf for one in parts if one.file):
        for path in sorted(folder.glob("*/*.yaml")):
            if (conf_folder() / path.relative_to(folder)).exists():
                raise InputError(
                    f"{path}: drivezoo has {path.parent.name}={path.stem}; rename the file"
                )
    return list(dict.fromkeys(one.conf for one in parts))


def choices(group: str) -> list[str]:
    """Return the names in a config group: the YAML files of its folders."""
    return sorted(choice_files(group))


def choice_files(group: str) -> dict[str, Path]:
    """Return the YAML file of each choice of a group, the user's parts included."""
    folders = [*part_folders(), conf_folder()]
    return {path.stem: path for one in folders for path in sorted((one / group).glob("*.yaml"))}


def keys_of(text: str, prefix: str = "") -> list[Key]:
    r"""Return the keys in the lines of a YAML file, with their comments.

    >>> keys_of("  port: 4567  # TCP port;\n              # 0 takes a free one")
    [Key(name='port', default='4567', comment='TCP port; 0 takes a free one')]
    """
    keys: list[Key] = []
    parents: list[tuple[int, str]] = []
    last = Key("", "", "")  # the key without a value, which may have a list below it
    for line in text.splitlines():
        found = _LINE.match(line)
        if found is None:
            if keys and line.strip().startswith("#"):  # the comment continues
                keys[-1] = Key(
                    keys[-1].name, keys[-1].default, f"{keys[-1].comment} {line.strip(' #')}"
                )
            elif line.strip().startswith("- ") and last not in keys:
                keys.append(last)
            continue
        indent = len(found["indent"])
        parents = [one for one in parents if one[0] < indent]
        name = prefix + "".join(f"{parent}." for _, parent in parents) + found["key"]
        value = found["value"].strip().strip("\"'")
        if not found["value"].strip():
            parents.append((indent, found["key"]))
            last = Key(name, "", found["comment"] or "")
        elif not found["key"].startswith("_"):
            keys.append(Key(name, value, found["comment"] or ""))
    return keys
