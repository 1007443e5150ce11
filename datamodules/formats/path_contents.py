"""What a path that is no recording holds, and what to name or to type instead."""

import difflib
from collections import Counter
from pathlib import Path

from datamodules.formats import table
from datamodules.known_formats import known_format
from datamodules.recording import LOG_NAME
from zoo.base.bounded_files import open_data
from zoo.base.errors import InputError
from zoo.base.terminal import command_line

SUGGESTED = 3  # recordings that a message names
LEVELS, MOST_FOLDERS = 3, 1000  # folders below a path in which recordings are looked for
LISTED = 2000  # files of a folder that are looked at
# Files whose names tell a format.
NAMES = ("interpolated.csv", "data.txt", "out-key.csv", "out-video.avi", LOG_NAME, "manifest.json")
PACKED = (".zip", ".tar", ".gz", ".tgz", ".xz", ".bz2", ".7z", ".rar", ".xlsx", ".xls", ".ods")
NEEDED = "name a folder with images or a video, and a table of their steering"


def is_recording(path: Path) -> bool:
    """Return whether a folder or file has one of the formats, or several."""
    try:
        return known_format(path) is not None
    except InputError:
        return True


def find_below(path: Path) -> list[Path]:
    """Return the nearest folders below a path that are recordings."""
    level, recordings = [path], list[Path]()
    for _ in range(LEVELS):
        level = [folder for parent in level for folder in _folders(parent)][:MOST_FOLDERS]
        recordings += [folder for folder in level if is_recording(folder)]
        level = [folder for folder in level if folder not in recordings]
    return recordings


def describe(path: Path) -> str:
    """Return what a path that is no recording lacks or holds, and the remedy, in one line."""
    if not path.exists():
        if len(path.parts) > 1 and path.parts[0].endswith(":"):
            return f"{path}: of addresses only s3:// is opened; download it, and name its folder"
        near = {folder.name: folder for folder in _folders(path.parent) if is_recording(folder)}
        names = difflib.get_close_matches(path.name, list(near), n=1)
        return f"{path}: no such folder; name {near[names[0]] if names else NEEDED[5:]}"
    is_single = path.is_file() and path.suffix.lower() in (*table.SUFFIXES, *PACKED)
    if not is_single or path.name.lower() in NAMES:
        parents = list(path.absolute().parents)[: LEVELS + 1]
        if whole := next(filter(is_recording, parents), None):
            return f"{path}: is no recording, but lies in one; name {whole}"
    if path.is_file():
        return f"{path}: {_file(path)}"
    what = f"{path}: holds no {LOG_NAME}, and is of no other format"
    if below := find_below(path):
        count = f"{len(below)} recording{' lies' if len(below) == 1 else 's lie'} below it"
        return f"{what}, but {count}; name {', or '.join(map(str, below[:SUGGESTED]))}"
    return f"{what}; {_folder(path)}"


def _folders(path: Path) -> list[Path]:
    """Return the folders in a folder, without hidden ones and those of macOS' archives."""
    names = sorted(path.iterdir()) if path.is_dir() else []
    return [name for name in names if not name.name.startswith((".", "__")) and name.is_dir()]


def _folder(path: Path) -> str:
    """Return what a folder holds, and the remedy."""
    files = [file for file in sorted(path.iterdir())[:LISTED] if file.name[0] != "."]
    files = [file for file in files if file.is_file()]
    for file in files:
        near = difflib.get_close_matches(file.name.lower(), NAMES, 1, 0.8)
        if near and file.name not in NAMES:
            return f"is {file.name} its {near[0]}? then rename it"
    if packed := [file for file in files if file.suffix.lower() in PACKED]:
        return f"its {packed[0].name} {_file(packed[0])}"
    if tables := [file for file in files if file.suffix.lower() in table.SUFFIXES]:
        return _tables(tables)
    if next(path.glob("data/chunk-*"), None):
        return "it is a LeRobotDataset without its meta/info.json; download it again"
    counts = Counter(file.suffix.lower() or file.name for file in files)
    held = ", ".join(f"{count:,} {suffix}" for suffix, count in counts.most_common(SUGGESTED))
    return f"it holds {held or 'no files'}; {NEEDED}"


def _file(path: Path) -> str:
    """Return what a file is, and the remedy."""
    folder, name = path.parent, path.name.lower()
    commands = {".zip": ["python", "-m", "zipfile", "-e", path, folder / path.stem]}
    commands |= {end: ["tar", "-xf", path, "-C", folder] for end in (".tar", ".tgz", ".tar.gz")}
    try:
        open_data(path, 1 << 62).close()
    except OSError as error:
        if "archive" not in f"{error.strerror}":
            return f"{error.strerror}"
    for end, command in commands.items():
        if name.endswith(end):
            return f"is an archive; type {command_line(command)}"
    if path.suffix.lower() in table.SUFFIXES:
        return _tables([path])
    return f"is a single {path.suffix or 'file'}; {NEEDED}"


def _tables(files: list[Path]) -> str:
    """Return the command that reads a table of images and steering, or what each table holds."""
    lines = []
    for file in files:
        try:
            columns, keys = table.find_columns(file)
        except InputError as error:
            lines.append(str(error))
            continue
        lines.append(f"{file.name} has the columns {', '.join(columns):.200}")
        if len(files) == 1 or table.UNKNOWN not in keys[-1]:
            line = command_line(["drivezoo", "check", file, *keys])
            return f"{lines[-1]}; type {line} (keys of a training begin with data.)"
    return f"{'; '.join(lines[:SUGGESTED])}: no table has images and their steering; join them"
