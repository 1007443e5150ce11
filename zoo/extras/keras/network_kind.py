"""The kind of a network's file or folder, by its content, and what makes it drive.

A name proves little: comma.ai's `.keras` of 2016 is HDF5, and a `.h5` may be PyTorch's archive.
"""

import io
import re
from pathlib import Path
from typing import BinaryIO

from zoo.base.bounded_files import open_binary
from zoo.base.errors import file_errors
from zoo.base.terminal import command_line
from zoo.checkpoints.network_files import (
    MOST_BYTES,
    PICKLE,
    SCRIPT,
    TORCH,
    ZIP,
    archive_names,
    describe_script,
    torch_kind,
)

WHOLE_SUFFIXES = (".h5", ".hdf5", ".keras")  # of files that can hold weights and layers
HDF5, KERAS, JSON, FOLDER, PACKED = "hdf5", "keras", "json", "folder", "packed"
IMPORTED = (HDF5, KERAS, JSON, FOLDER, PACKED)  # kinds that `drivezoo import` reads
TOPS = {"config.json", "metadata.json", "model.weights.h5"}  # of an archive of Keras 3
IMPORT = "make a checkpoint of it: {import}"
SAVE = "save it in its own environment with model.save('model.h5'), then drivezoo import model.h5"
# What a file is, and what to do with it.
KINDS = {
    HDF5: ("an HDF5 file, as Keras writes it", IMPORT),
    KERAS: ("an archive of Keras 3", IMPORT),
    JSON: ("JSON, as Keras writes the layers of a network", IMPORT),
    FOLDER: ("a folder with a network of Keras", IMPORT),
    PACKED: ("a zip with a network of Keras", IMPORT),
    TORCH: ("PyTorch's, whose layers are code", "drivezoo import tells how it drives"),
    "onnx": (
        "an ONNX file; only those that drivezoo export wrote drive, with a name in .onnx",
        "name the checkpoint, or import the network of Keras, that it was exported from",
    ),
    "model": ("a SavedModel or a graph of TensorFlow, which is not read", f"load it and {SAVE}"),
    "tensors": (
        "a checkpoint of TensorFlow, which has weights without layers",
        f"build its model, load the weights and {SAVE}",
    ),
    "lite": (
        "a file of TensorFlow Lite, which is not read",
        "its training wrote a .h5 or .keras beside it: drivezoo import that",
    ),
    PICKLE: ("a pickle of Python, whose code is not run", f"load its model and {SAVE}"),
    "archive": ("packed", "unpack it, and name the network in it"),
    "page": ("a web page, not the file itself", "download the raw file"),
    "empty": ("empty (0 bytes)", "copy it again"),
}
# Begins of files; the first that matches. Protocol buffers begin with their version.
BEGINS = {
    HDF5: rb"\x89HDF\r\n\x1a\n",
    "lite": rb".{4}TFL3",
    "model": rb"\x08\x01\x12",
    "onnx": rb"\x08[\x02-\x20][\x12\x1a\x22\x28\x32\x3a\x42]",
    "tensors": rb"model_checkpoint_path:",
    "archive": rb"\x1f\x8b|7z\xbc\xaf|Rar!|BZh|\xfd7zXZ",
    "page": rb"\s*(?i:<!doctype html|<html)",
    JSON: rb'(\xef\xbb\xbf)?\s*["{]',
}
TABLE_END = b"\x57\xfb\x80\x8b\x24\x75\x47\xdb"  # of TensorFlow's tables of tensors
NAMES = {"tensors": r"\.index$|\.meta$|\.data-\d{5}-of-\d{5}$", "model": r"\.pb(txt)?$"}


def network_kind(path: Path) -> str:
    """Return the kind of a file or folder, a key of `KINDS`; empty for any other content.

    Raises:
        InputError: the file cannot be read.
    """
    if path.is_dir():
        return _folder_kind(path)
    if not path.exists():
        return ""
    with file_errors(path, "{}; name another file"), open_binary(path, MOST_BYTES) as file:
        return _file_kind(file, path.name)


def _file_kind(file: BinaryIO, name: str) -> str:
    """Return the kind of an opened file; its name counts where its content tells nothing."""
    if kind := torch_kind(file):
        return kind
    file.seek(0)
    begin = file.read(512)
    if not begin:
        return "empty"
    if begin.startswith(ZIP):
        names = archive_names(file, begin)
        has_network = any(name.lower().endswith(WHOLE_SUFFIXES) for name in names)
        return KERAS if TOPS & set(names) else PACKED if has_network else "archive"
    kind = next((kind for kind, form in BEGINS.items() if re.match(form, begin, re.DOTALL)), "")
    file.seek(-min(len(TABLE_END), len(begin)), io.SEEK_END)
    return "tensors" if file.read() == TABLE_END else kind or _kind_of_name(name)


def describe_kind(path: Path, kind: str) -> str:
    """Return what a file is and what to do with it, for one line after the path."""
    if kind == SCRIPT:
        return describe_script(path)
    what, remedy = KINDS[kind]
    command = command_line(["drivezoo", "import", path])
    return f"is {what}; {remedy.replace('{import}', command)}"


def networks_in(folder: Path) -> list[Path]:
    """Return the Keras files in a folder and, as a packed repository has them, one level below."""
    paths = [*folder.glob("*"), *folder.glob("*/*")]
    return sorted(
        path
        for path in paths
        if path.suffix.lower() in WHOLE_SUFFIXES and not path.name.startswith(".")
    )


def _folder_kind(folder: Path) -> str:
    names = [_kind_of_name(path.name) for path in (*folder.glob("*"), *folder.glob("variables/*"))]
    if "model" in names or (folder / "variables").is_dir():
        return "model"
    return "tensors" if "tensors" in names else FOLDER if networks_in(folder) else ""


def _kind_of_name(name: str) -> str:
    return next((kind for kind, end in NAMES.items() if re.search(end, name.lower())), "")
