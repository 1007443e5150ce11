"""YAML files of `conf`: their folder, the choices of each group, and the keys in a file."""

from __future__ import annotations

import ast
import functools
import importlib.util
import re
from pathlib import Path

from zoo.base.errors import InputError
from zoo.base.parts import named_parts

_LINE = re.compile(r"(?P<indent> *)(?P<key>\w+):(?P<value>[^#]*)(?:#\s*(?P<comment>.*))?$")


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
    parts = [(part.conf, part.file) for part in named_parts() if part.conf]
    parts = [(folder, file) for folder, file in parts if not is_conf_folder(folder)]
    for folder in dict.fromkeys(folder for folder, file in parts if file):
        for path in sorted(folder.glob("*/*.yaml")):
            if (conf_folder() / path.relative_to(folder)).exists():
                raise InputError(
                    f"{path}: drivezoo has {path.parent.name}={path.stem}; rename the file"
                )
    return list(dict.fromkeys(folder for folder, _ in parts))


def choices(group: str) -> list[str]:
    """Return the names in a config group: the YAML files of its folders."""
    return sorted(choice_files(group))


def choice_files(group: str) -> dict[str, Path]:
    """Return the YAML file of each choice of a group, the user's parts included."""
    folders = [*part_folders(), conf_folder()]
    return {
        path.stem: path for folder in folders for path in sorted((folder / group).glob("*.yaml"))
    }


@functools.cache
def trainer_arguments() -> tuple[str, ...]:
    """Return the arguments of Lightning's Trainer that are keys of no YAML file.

    They are read from its source, since an import takes seconds.
    """
    spec = importlib.util.find_spec("lightning")
    folder = Path(str(spec and spec.origin)).parent
    source = (folder / "pytorch" / "trainer" / "trainer.py").read_text(encoding="utf-8")
    functions = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef))
    called = next(node for node in functions if node.name == "__init__")
    yaml = comments_of((conf_folder() / "trainer" / "default.yaml").read_text(encoding="utf-8"))
    return tuple(node.arg for node in called.args.kwonlyargs if node.arg not in yaml)


def comments_of(text: str, prefix: str = "") -> dict[str, str]:
    r"""Return the comment of each key in the lines of a YAML file, by its dotted name.

    >>> comments_of("  port: 4567  # TCP port;\n              # 0 takes a free one")
    {'port': 'TCP port; 0 takes a free one'}
    """
    comments: dict[str, str] = {}
    parents: list[tuple[int, str]] = []
    name = ""
    for line in text.splitlines():
        match = _LINE.match(line)
        if match is None:
            if name and line.strip().startswith("#"):  # the comment continues
                comments[name] = f"{comments[name]} {line.strip(' #')}".strip()
            continue
        indent, key = len(match["indent"]), match["key"]
        parents = [(above, parent) for above, parent in parents if above < indent]
        name = prefix + "".join(f"{parent}." for _, parent in parents) + key
        comments[name] = match["comment"] or ""
        if not match["value"].strip():
            parents.append((indent, key))
    return {name: comment for name, comment in comments.items() if comment}
