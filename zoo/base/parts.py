"""Parts outside drivezoo: the user's own networks, losses, callbacks, metrics and more.

Only the user who types a command, or who installed a package, chooses code that runs. The user
names files, folders and modules with `parts=NAME,NAME` or in the environment variable
`DRIVEZOO_PARTS`; a package names modules as entry points of the group `drivezoo.parts`. A
checkpoint, a run's folder or a recording names none. The variable also takes the typed names to
processes that a command starts.

A part is imported when a config names one of its classes. Its YAML files stand in `conf` next to
it, arranged as drivezoo's own: `conf/model/NAME.yaml`. Metrics and perturbations need no YAML file:
a part that registers some is imported when they are first read (see `zoo.base.registry`).
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import inspect
import os
import re
import sys
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from zoo.base.entry_points import EXTRAS, installed_entries
from zoo.base.errors import InputError, UsageError

KEY, VARIABLE, GROUP = "parts", "DRIVEZOO_PARTS", "drivezoo.parts"
MEANING = f"files, folders or modules of your own networks, losses, ...; see also {VARIABLE}"
_REGISTERS = re.compile(r"(?m)^(@(\w+\.)*(metric|perturbation|world)\b|\s*(gym[\w.]*)?register\()")
_FORMAT = re.compile(r"^def detect\(", re.MULTILINE)
_CLASS = re.compile(r"^\s*class \w", re.MULTILINE)


@dataclass(frozen=True)
class Part:
    """A module outside drivezoo that configs may name.

    Attributes:
        module: full name.
        file: its file; None for a module that Python finds by its name.
        conf: folder of its YAML files; None without one.
    """

    module: str
    file: Path | None = None
    conf: Path | None = None

    @property
    def is_extra(self) -> bool:
        """Return whether it is drivezoo's own: its errors are bugs, and its code has no hash."""
        return self.module.startswith(EXTRAS)

    @property
    def name(self) -> str:
        """Return the name that a user types after `parts=`, without the folder."""
        return self.file.name if self.file else self.module

    def holds(self, module: str) -> bool:
        """Return whether a module is this part, or lies in this package."""
        return module == self.module or (self.file is None and module.startswith(f"{self.module}."))

    def matches(self, *patterns: re.Pattern) -> bool:
        """Return whether the file has one of the patterns; True for a module."""
        if self.file is None:
            return True
        text = self.file.read_text(encoding="utf-8", errors="replace")
        return any(pattern.search(text) for pattern in patterns)


def take_parts(arguments: Sequence[str]) -> list[str]:
    """Return the arguments without `parts=...`; add those parts to the environment variable.

    Raises:
        InputError: a named part does not exist.
    """
    typed = [argument for argument in arguments if argument.startswith(f"{KEY}=")]
    texts = [name for word in typed for name in word.partition("=")[2].strip("[]").split(",")]
    names = [name.strip() for name in texts if name.strip()]
    if typed and not names:
        raise UsageError(f"{typed[0]}: names no part; write {KEY}=FILE.py")
    name_parts(names)
    for name in names:
        parts = _parts_of(_absolute(name, name))
        if not any(part.conf or part.matches(_CLASS, _REGISTERS, _FORMAT) for part in parts):
            print(
                f"{name}: registers nothing: it has no class, no function with @metric, "
                "@perturbation or @world, and no detect of a format",
                file=sys.stderr,
            )
    return [argument for argument in arguments if argument not in typed]


def name_parts(names: Iterable[str]) -> None:
    """Add parts to those of the environment variable, for this process and those it starts.

    Raises:
        InputError: see `take_parts`; or a file was edited after this process had imported it.
    """
    whole = dict.fromkeys(filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)))
    for name in names:
        path = _absolute(name, f"{KEY}={name}")
        if os.pathsep in path:
            raise InputError(f"{KEY}={path}: a path with {os.pathsep} cannot be used; rename it")
        whole[path] = None
    if whole:
        os.environ[VARIABLE] = os.pathsep.join(whole)
        for part in named_parts():
            spec = getattr(sys.modules.get(part.module), "__spec__", None)
            if spec and part.file and spec.loader_state not in (None, part.file.read_bytes()):
                raise InputError(f"{part.file}: was edited after its import; restart Python")


def typed_parts() -> list[str]:
    """Return the `parts=...` that the user typed, for commands that are printed."""
    return [argument for argument in sys.orig_argv if argument.startswith(f"{KEY}=")]


def named_parts() -> tuple[Part, ...]:
    """Return all parts: the user's, then those of installed packages.

    Python then finds the modules of files and folders by their names.

    Raises:
        InputError: a part in the environment variable does not exist.
    """
    return (*_users_parts(), *_installed(GROUP))


def registering_parts(group: str) -> tuple[list[Part], list[Part]]:
    """Return the parts that may register functions: the user's, and those of installed packages.

    Of the user's files, only those that register by a decorator or a call: others may be scripts.

    Args:
        group: group of the packages' entry points.
    """
    return [part for part in _users_parts() if part.matches(_REGISTERS)], list(_installed(group))


def format_parts() -> list[Part]:
    """Return the user's parts that may be formats of recordings: modules, and files with `detect`.

    Formats of installed packages need not be modules.
    """
    return [part for part in _users_parts() if part.matches(_FORMAT)]


def _users_parts() -> tuple[Part, ...]:
    return _parts_of(os.environ.get(VARIABLE, ""))


def part_of(target: object) -> Part | None:
    """Return the part outside drivezoo whose module a `_target_` names, or None."""
    part = _holder(target)
    return part if part and not part.is_extra else None


def _holder(target: object) -> Part | None:
    module = target.rpartition(".")[0] if isinstance(target, str) else ""
    return next((part for part in named_parts() if part.holds(module)), None)


def part_class(target: object) -> type | None:
    """Return the class of a part or an extra that a `_target_` names; None if it is no part's.

    Raises:
        InputError: the part cannot be imported, or defines no such class.
    """
    part = _holder(target)
    if part is None:
        return None
    module, _, name = str(target).rpartition(".")
    kind = getattr(import_part(part, module), name, None)
    # Refuse `my_net.nn.Sequential` and what the part imported: the module must define the class.
    if not inspect.isclass(kind) or kind.__module__ != module:
        raise InputError(f"{part.name}: defines no class {name}; correct _target_={target!s:.200}")
    return kind


def import_part(part: Part, module: str) -> object:
    """Return a module of a part.

    Raises:
        InputError: the part cannot be imported, or Python finds another module of its name.
    """
    if part.file is not None:
        loaded = getattr(sys.modules.get(module), "__file__", None)
        spec = None if loaded else importlib.util.find_spec(module)
        source = loaded or (spec and spec.origin) or "built in"
        if Path(source).resolve() != part.file:
            raise InputError(
                f"{part.file}: Python has another module {module} ({source}); rename the file"
            )
    with part_errors(part):
        imported = importlib.import_module(module)
    if part.file is not None:
        spec = vars(imported)["__spec__"]  # a reload makes another one
        spec.loader_state = spec.loader_state or part.file.read_bytes()
    return imported


@contextmanager
def part_errors(part: Part | None) -> Iterator[None]:
    """Turn any error of a part's code, `sys.exit` included, into one line with its file and line.

    Raises:
        InputError: the part's code raised an error.
    """
    try:
        yield
    except (InputError, KeyboardInterrupt):
        raise
    except BaseException as error:
        if part is None:
            raise
        raise _in_one_line(error, part, _lines_in(part, error)) from error


def part_failure(error: BaseException) -> InputError | None:
    """Return an error of one line if a part's or an installed package's code raised it."""
    # A package's command may end with a status of its own.
    installed = _installed("drivezoo." if isinstance(error, Exception) else GROUP)
    try:
        parts = (*_users_parts(), *installed)
    except InputError:  # a file was deleted meanwhile
        return None
    passed = ((part, _lines_in(part, error)) for part in parts if not part.is_extra)
    return next((_in_one_line(error, part, lines) for part, lines in passed if lines), None)


def _lines_in(part: Part, error: BaseException) -> list[int | None]:
    """Return the lines of a part's file through which an error passed, or that it is about."""
    module = sys.modules.get(part.module)
    file = str(part.file or getattr(module, "__file__", None) or part.name)
    frames = traceback.extract_tb(error.__traceback__)
    lines: list[int | None] = [frame.lineno for frame in frames if frame.filename == file]
    # A method or an argument is missing: `MyLoss.forward() takes 2`, `'MyLoss' object has no`.
    kind = getattr(module, re.split(r"\W", str(error).lstrip("'"))[0], None)
    if not lines and inspect.isclass(kind) and kind.__module__ == part.module:
        lines.append(inspect.getsourcelines(kind)[1])
    return lines


def _in_one_line(error: BaseException, part: Part, lines: list[int | None]) -> InputError:
    source = f"{part.name}: line {lines[-1]}" if lines else part.name
    reason = " ".join(str(error).split())
    return InputError(f"{source}: {type(error).__name__}: {reason:.300}; correct it")


def unknown_part(target: object) -> str:
    """Return the remedy for a class that no part defines, or that is no network."""
    if part := part_of(target):
        return f"{part.name} defines no such network; derive the class from torch.nn.Module"
    module = str(target).rpartition(".")[0]
    if module.startswith(EXTRAS):
        return f"the extra {module:.100} of drivezoo is missing; install drivezoo again"
    name = module if "." in module else f"{module}.py"
    return f"if you have {name:.100} and trust it, add {KEY}={name:.100}"


def _absolute(name: str, source: str) -> str:
    """Return a file or folder as an absolute path, and a module's name unchanged."""
    path = os.path.expanduser(name)  # noqa: PTH111 Path's raises for an unknown user
    if os.path.isdir(path):  # noqa: PTH112 Path's raises for a name that is too long
        if not _modules_in(Path(path)):
            raise InputError(f"{source}: holds no .py file; name a file, or another folder")
        return str(Path(path).resolve())
    if os.path.isfile(path):  # noqa: PTH113
        file = Path(path).resolve()
        if file.suffix != ".py" or not file.stem.isidentifier():
            raise InputError(f"{source}: is no Python module; rename it, such as my_net.py")
        return str(file)
    is_module = all(word.isidentifier() for word in name.split(".")) and not name.endswith(".py")
    if not is_module or importlib.util.find_spec(name.partition(".")[0]) is None:
        raise InputError(f"{source}: no such file or module; name a .py file, or its folder")
    return name


def _parts_of(named: str) -> tuple[Part, ...]:
    parts: list[Part] = []
    for text in filter(None, named.split(os.pathsep)):
        name = _absolute(text, f"{VARIABLE}: {text}")
        is_path = Path(name).is_absolute()
        if is_path and not Path(os.path.expanduser(text)).is_absolute():  # noqa: PTH111
            # Another folder, such as a downloaded one, may have a file of that name.
            raise InputError(f"{VARIABLE}: {text}: is not a whole path; write {name}")
        if not is_path:
            parts.append(Part(name, conf=_conf_in(_package_folder(name))))
            continue
        path = Path(name)
        folder = path if path.is_dir() else path.parent
        if str(folder) not in sys.path:
            sys.path.append(str(folder))  # last: it hides no installed module
        files = [path] if path.is_file() else _modules_in(folder)
        parts += [Part(file.stem, file, _conf_in(folder)) for file in files]
    return tuple(dict.fromkeys(parts))


def _modules_in(folder: Path) -> list[Path]:
    """Return the files in a folder that can hold parts: no tests, no `__init__.py`."""
    files = sorted(folder.glob("[!_]*.py"))
    return [
        path for path in files if path.stem.isidentifier() and not path.stem.startswith("test_")
    ]


@functools.cache
def _installed(group: str) -> tuple[Part, ...]:
    modules = sorted({entry.module for entry in installed_entries(group)})
    return tuple(Part(name, conf=_conf_in(_package_folder(name))) for name in modules)


def _package_folder(module: str) -> Path | None:
    """Return the folder of the innermost package of a module's name, without importing it."""
    top, *rest = module.split(".")
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return None
    if spec is None or not spec.submodule_search_locations:
        return None
    folder = Path(next(iter(spec.submodule_search_locations)))
    for name in rest:
        if not (folder / name).is_dir():
            break
        folder /= name
    return folder


def _conf_in(folder: Path | None) -> Path | None:
    return folder / "conf" if folder and (folder / "conf").is_dir() else None
