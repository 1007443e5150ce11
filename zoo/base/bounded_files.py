"""Bounded readers: regular files, and untrusted JSON and YAML as plain containers.

A pipe, device or folder is refused without waiting for it. The kind and the size are checked on the
opened descriptor, so that the file cannot be replaced in between. A symbolic link to a regular file
is allowed.
"""

import errno
import hashlib
import io
import json
import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import yaml

from zoo.base.errors import InputError, file_errors, hint
from zoo.base.file_kind import HEAD_BYTES, MOST_POINTER_BYTES, POINTER, check_kind
from zoo.base.limits import MOST

MOST_LINE = 1_000_000  # characters of a row of text
MOST_HASHED_BYTES = 8_000_000_000
# O_NONBLOCK: opening a pipe does not wait for its writer. Regular files ignore it.
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
MOST_JSON_BYTES = 16_000_000
MOST_YAML_BYTES = 1_000_000
MOST_DIGITS = 4300  # of a number; Python's own limit
MOST_GROUPS = 100  # of base 60: YAML 1.1 reads 1:30 as 90
MOST_BITS = 14_280  # of a number with fewer digits

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_STARTS = (yaml.MappingStartEvent, yaml.SequenceStartEvent)
_ENDS = (yaml.MappingEndEvent, yaml.SequenceEndEvent)
_NUMBER = re.compile(r"[\s_]*[-+0-9.]")
_UNUSABLE = re.compile("[\0\ud800-\udfff]")
# As Python does, a path's bytes that are not UTF-8 are saved as \udc80 to \udcff.
_UNUSABLE_IN_PATHS = re.compile("[\0\ud800-\udc7f\udd00-\udfff]")
_ESCAPED_BYTE = re.compile(r"\\uDC[89A-F]")


def read_json(path: Path) -> object:
    """Return a JSON file's contents.

    Raises:
        InputError: the file cannot be read, is too large or too deep, or is not JSON.
    """
    with _valid(path, "JSON"):
        return check_text(parse_json(read_text(path, MOST_JSON_BYTES)))


def check_version(
    version: object, supported: int, path: object, remedy: str = "use the drivezoo that wrote it"
) -> None:
    """Raise InputError if a file's format version, any value, is not the known one."""
    if type(version) is not int or version != supported:
        shown = " ".join(str(version).split())
        raise InputError(
            f"{path}: has format version {shown:.40}, this drivezoo reads {supported}; {remedy}"
        )


def parse_json(text: str) -> object:
    """Return a JSON text's contents; raise ValueError for any error in it."""
    if sum(map(text.count, ",[{")) > MOST["values"]:  # 5 million empty lists take 300 MB
        raise ValueError(f"has more than {MOST['values']:,} values")
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError(f"nested deeper than {MOST['levels']} levels") from None


def read_like(path: Path, folder: Path) -> object:
    """Return a YAML file's contents; `like: NAME` adds what they leave out from folder/NAME.yaml.

    Raises:
        InputError: as `read_yaml`, or there is no such file in the folder.
    """
    content = read_yaml(path)
    if not isinstance(content, dict) or "like" not in content:
        return content
    name, names = content.pop("like"), sorted(file.stem for file in folder.glob("*.yaml"))
    if name not in names:
        raise InputError(f"{path}: like: {name!a:.80} is not included; {hint(str(name), names)}")
    base = read_yaml(folder / f"{name}.yaml")
    return base | content if isinstance(base, dict) else content


def read_yaml(path: Path, any_path: bool = False) -> object:
    """Return a YAML file's contents; raise as `read_json`, and for aliases and tags.

    Args:
        path: file to read.
        any_path: whether texts may contain paths that are not UTF-8, as Hydra saves them.
    """
    with _valid(path, "YAML"):
        return parse_yaml(read_text(path, MOST_YAML_BYTES), any_path)


def read_yaml_text(path: Path, any_path: bool = False) -> str:
    """Return a YAML file's text after `check_yaml`; raise as `read_yaml`."""
    text = read_text(path, MOST_YAML_BYTES)
    with _valid(path, "YAML"):
        check_yaml(text, any_path)
    return text


def parse_yaml(text: str, any_path: bool = False) -> object:
    """Return a YAML text's contents; raise ValueError for any error in it."""
    check_yaml(text, any_path)
    try:
        return check_text(yaml.load(text, _loader(text, any_path)), any_path)
    except yaml.YAMLError as error:
        raise ValueError(_reason(error)) from None


def check_yaml(text: str, any_path: bool = False) -> None:
    """Raise ValueError for a text that is not YAML, or would take too much time or memory."""
    depth = 0
    try:
        for event in yaml.parse(text, _loader(text, any_path)):
            line = event.start_mark.line + 1
            if isinstance(event, yaml.AliasEvent):  # a few can expand to millions of values
                raise ValueError(f"line {line}: *{event.anchor} is an alias; write its value")
            if getattr(event, "tag", None) is not None:
                raise ValueError(f"line {line}: {event.tag:.80} is a tag; delete it")
            depth += isinstance(event, _STARTS) - isinstance(event, _ENDS)
            if depth > MOST["levels"]:
                raise ValueError(f"line {line}: nested deeper than {MOST['levels']} levels")
            if isinstance(event, yaml.ScalarEvent) and not event.style:
                size = len(event.value)
                is_long = size > MOST_DIGITS or event.value.count(":") > MOST_GROUPS
                if is_long and _NUMBER.match(event.value):
                    raise ValueError(f"line {line}: a number of {size:,} digits")
    except yaml.YAMLError as error:
        raise ValueError(_reason(error)) from None


def read_text(path: Path, most_bytes: int) -> str:
    """Return a file's text; raise InputError if it cannot be read, is too large or not UTF-8."""
    try:
        with file_errors(path, "cannot be read ({})"):
            data = read_regular(path, most_bytes)
            check_kind(data[:HEAD_BYTES], path)
            return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start + 1:,} is not UTF-8; save it as UTF-8"
        ) from None


def check_text(content: object, any_path: bool = False) -> Any:
    """Return plain containers; raise ValueError for too many values or levels, or unusable text.

    A value counts as often as it is reached: lists that share their parts can hold billions.
    """
    unusable = _UNUSABLE_IN_PATHS if any_path else _UNUSABLE
    level, count = [content], 1
    for _ in range(MOST["levels"] + 1):
        if not level:
            return content
        for value in level:
            if isinstance(value, str) and unusable.search(value):
                raise ValueError(f"{value[:40]!a} contains a NUL or half a character")
            if isinstance(value, int) and value.bit_length() > MOST_BITS:
                raise ValueError(f"a number of more than {MOST_DIGITS:,} digits")
        dicts = [value for value in level if isinstance(value, dict)]
        inner = [value for value in level if isinstance(value, list | tuple)]
        count += sum(map(len, inner)) + 2 * sum(map(len, dicts))
        if count > MOST["values"]:
            raise ValueError(f"has more than {MOST['values']:,} values")
        level = [child for sequence in inner for child in sequence]
        level += [child for dictionary in dicts for pair in dictionary.items() for child in pair]
    raise ValueError(f"nested deeper than {MOST['levels']} levels")


def mapped(function: Callable[[Any], Any], value: Any) -> Any:
    """Return plain containers with the function of each value in them.

    >>> mapped(str, {"a": [1, {"b": 2}]})
    {'a': ['1', {'b': '2'}]}
    """
    if isinstance(value, Mapping):
        return {key: mapped(function, item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [mapped(function, item) for item in value]
    return function(value)


def leaves(node: object, keys: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], object]]:
    """Yield each value in plain containers, with its keys.

    >>> list(leaves({"a": [1, {"b": 2}]}))
    [(('a', '0'), 1), (('a', '1', 'b'), 2)]
    """
    if isinstance(node, Mapping):
        pairs: Iterable[tuple[object, object]] = node.items()
    elif isinstance(node, list | tuple):
        pairs = enumerate(node)
    else:
        yield keys, node
        return
    for name, value in pairs:
        yield from leaves(value, (*keys, str(name)))


@contextmanager
def _valid(path: Path, language: str) -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise InputError(f"{path}: is not valid {language} ({_reason(error)})") from None


def _loader(text: str, any_path: bool) -> Any:
    """Return the safe loader; the one in C rejects the surrogates of paths, which PyYAML writes."""
    return yaml.SafeLoader if any_path and _ESCAPED_BYTE.search(text) else _LOADER


def _reason(error: Exception) -> str:
    mark = getattr(error, "problem_mark", None)
    if mark is not None:
        return f"line {mark.line + 1}: {getattr(error, 'problem', '')}"
    return " ".join(str(error).split()) or type(error).__name__


def open_regular(path: str | Path, most_bytes: int) -> tuple[int, int]:
    """Return a regular file's descriptor, for reading, and its size.

    Raises:
        OSError: the file is missing, not regular, above `most_bytes`, or a Git LFS pointer;
            `strerror` says why.
    """
    try:
        descriptor = os.open(path, _FLAGS)
    except ValueError as error:  # a NUL in the path
        raise OSError(errno.EINVAL, str(error), ascii(str(path))) from None
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            kind = "is a directory, no" if stat.S_ISDIR(status.st_mode) else "is no"
            raise OSError(errno.EINVAL, f"{kind} regular file", str(path))
        if status.st_size > most_bytes:
            reason = f"has {status.st_size:,} bytes, more than the {most_bytes:,} that are read"
            raise OSError(errno.EFBIG, reason, str(path))
        if 0 < status.st_size < MOST_POINTER_BYTES:
            if os.read(descriptor, len(POINTER)) == POINTER:
                check_kind(POINTER, path)
            os.lseek(descriptor, 0, os.SEEK_SET)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor, status.st_size


def read_regular(path: str | Path, most_bytes: int) -> bytes:
    """Return a file's bytes, as many as it had when it was opened.

    It raises what `open_regular` raises. It makes few system calls, because threads queue for
    Python's lock after each.
    """
    descriptor, size = open_regular(path, most_bytes)
    try:
        data = os.read(descriptor, size)
        while len(data) < size and (chunk := os.read(descriptor, size - len(data))):
            data += chunk
        return data
    finally:
        os.close(descriptor)


def hash_file(path: str | Path) -> str:
    """Return the SHA-256 of a file's contents, read in pieces.

    Raises:
        InputError: the file is missing, not regular or too large.
    """
    digest = hashlib.sha256()
    with file_errors(path), open_binary(path, MOST_HASHED_BYTES) as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def open_binary(path: str | Path, most_bytes: int) -> BinaryIO:
    """Open a regular file for reading; raises what `open_regular` raises."""
    descriptor, size = open_regular(path, most_bytes)
    if not size:  # the kernel's files, such as /proc/kmsg, may be endless
        os.close(descriptor)
        return io.BytesIO()
    return os.fdopen(descriptor, "rb")


def open_data(path: str | Path, most_bytes: int) -> BinaryIO:
    """Open a file of a recording; raises as `open_binary`, and for a file of no such kind."""
    file = open_binary(path, most_bytes)
    try:
        check_kind(file.read(HEAD_BYTES), path)
    except OSError:
        file.close()
        raise
    file.seek(0)
    return file


def open_text(path: str | Path, most_bytes: int, errors: str = "strict") -> TextIO:
    """Open a CSV file, UTF-8 with or without a byte order mark; keep its line ends.

    Raises:
        InputError: the file is missing, not regular, too large, or of another kind.
    """
    with file_errors(path):
        file = open_data(path, most_bytes)
    return _BoundedLines(file, path, errors)


class _BoundedLines(io.TextIOWrapper):
    """A text whose iteration refuses a line that is too long, such as a sparse file's."""

    def __init__(self, file: BinaryIO, path: str | Path, errors: str) -> None:
        super().__init__(file, encoding="utf-8-sig", errors=errors, newline="")
        self._path = path

    def __next__(self) -> str:  # type: ignore[override]
        line = self.readline(MOST_LINE + 1)
        if len(line) > MOST_LINE:
            raise InputError(
                f"{self._path}: has a row of more than {MOST_LINE:,} characters; name another file"
            )
        if not line:
            raise StopIteration
        return line
