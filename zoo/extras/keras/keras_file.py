"""Read a Keras model, architecture and weights, from `.h5`, `.json` with `.h5`, or `.keras`.

Nothing in a file is run or unpickled, sizes are bounded, and of a zip only such files are unpacked,
for as long as they are read. A Lambda's code stays the text that it is in the file.
"""

import io
import re
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from zoo.base.bounded_files import MOST_JSON_BYTES, open_binary, read_text
from zoo.base.errors import InputError, optional_import
from zoo.base.limits import MOST, open_archive
from zoo.base.plain_files import check_text, parse_json
from zoo.base.process_pool import read_apart
from zoo.checkpoints.network_files import TORCH
from zoo.extras.keras.keras_arrays import WeightsFile
from zoo.extras.keras.keras_model import KerasLayer, joined_outputs, read_architecture
from zoo.extras.keras.keras_model import KerasModel as KerasModel
from zoo.extras.keras.network_kind import (
    FOLDER,
    IMPORTED,
    JSON,
    KERAS,
    PACKED,
    WHOLE_SUFFIXES,
    describe_kind,
    network_kind,
    networks_in,
)

MOST_BYTES = 4_000_000_000
SUFFIXES = (*WHOLE_SUFFIXES, ".json")
CONFIG, METADATA, WEIGHTS = "config.json", "metadata.json", "model.weights.h5"  # of `.keras`


def read_keras(
    path: str | Path, weights: str | Path | None = None, as_chain: bool = True
) -> KerasModel:
    """Return a model that Keras 1, 2 or 3 saved.

    Args:
        path: file of HDF5, `.keras` or JSON, by its content; or a folder or a zip with only one.
        weights: `.h5` file for a `.json`; None to find it in the same folder.
        as_chain: whether to refuse a model that is no chain of layers, and to look for the `.json`
            of a `.h5` file of weights alone in the same folder.

    Raises:
        InputError: h5py is not installed; a file is missing, damaged, too large, or not of Keras;
            or the model is not a chain of layers.
    """
    path = Path(path)
    kind = network_kind(path)
    is_json = kind == JSON or path.suffix.lower() == ".json"
    if weights is not None and not is_json:
        raise InputError(f"{path}: weights={weights} belongs to a .json file; name that file")
    if kind == FOLDER:
        return read_keras(_only_network(path), None, as_chain)
    if kind == PACKED:
        return _read_packed(path, as_chain)
    if is_json:
        file = Path(weights) if weights is not None else _weights_of(path)
        return replace(_read_h5(file, path, as_chain), path=path)
    if kind == KERAS or (not kind and path.suffix.lower() == ".keras"):
        return _read_zip(path, as_chain)
    return _read_h5(path, None, as_chain)


def read_keras_apart(path: str | Path, *arguments: Any) -> KerasModel:
    """Return what `read_keras` returns, read by a process of its own.

    Raises:
        InputError: see `read_keras` and `read_apart`.
    """
    check_kind(Path(path))
    return read_apart(read_keras, Path(path), *arguments)


def check_kind(path: Path) -> None:
    """Raise InputError for a file that is of another kind than Keras', by its content."""
    check_exists(path)
    kind = network_kind(path)
    if kind == TORCH:
        from zoo.checkpoints.checkpoint import read_checkpoint_file  # slow import: torch

        read_checkpoint_file(path)
        raise InputError(
            f"{path}: is a checkpoint of drivezoo, which drives as it is: drivezoo drive {path}"
        )
    if kind and kind not in IMPORTED:
        raise InputError(f"{path}: {describe_kind(path, kind)}")


def _only_network(folder: Path) -> Path:
    """Return the only file of a network in a folder."""
    paths = networks_in(folder)
    if len(paths) == 1:
        return paths[0]
    names = ", ".join(str(path.relative_to(folder)) for path in paths)
    raise InputError(f"{folder}: holds {len(paths)} networks ({names:.300}); name one of them")


def _read_packed(path: Path, as_chain: bool) -> KerasModel:
    """Return the model of the only network in a zip."""
    with TemporaryDirectory() as folder:
        with (
            _naming_damage(path, "zip"),
            open_binary(path, MOST_BYTES) as raw,
            open_archive(raw, path) as archive,
        ):
            for name in archive.namelist():
                if name.lower().endswith(SUFFIXES) and not name.startswith("__MACOSX"):
                    archive.extract(name, folder)
        try:
            return replace(read_keras(_only_network(Path(folder)), None, as_chain), path=path)
        except InputError as error:
            raise InputError(str(error).replace(folder, str(path))) from None


def _read_h5(path: Path, json: Path | None, as_chain: bool) -> KerasModel:
    config = None if json is None else _json_model(json)
    with (
        _naming_damage(path, "HDF5") as hdf5,
        open_binary(path, MOST_BYTES) as raw,
        hdf5(raw, "r") as file,
    ):
        weights = WeightsFile(file, path, raw.seek(0, io.SEEK_END))
        if not weights.is_legacy and not weights.is_keras_3:
            raise InputError(
                f"{path}: holds no layers of Keras; save the model with model.save('model.h5')"
            )
        if config is None and "model_config" in file.attrs:
            config = _checked_model(weights.attribute("model_config"), path)
        if config is None and as_chain and (json := _json_of(path)):
            config = _json_model(json)
        return _model(path, config, weights, as_chain, json)


def _read_zip(path: Path, as_chain: bool) -> KerasModel:
    with _naming_damage(path, ".keras") as hdf5, open_binary(path, MOST_BYTES) as raw:
        with open_archive(raw, path) as archive:
            config = _checked_model(_member(archive, CONFIG, path).decode(), path)
            if METADATA in archive.namelist():
                metadata = parse_json(_member(archive, METADATA, path).decode())
                config |= metadata if isinstance(metadata, dict) else {}
            weights = _member(archive, WEIGHTS, path)
        with hdf5(io.BytesIO(weights), "r") as file:
            return _model(path, config, WeightsFile(file, path, len(weights)), as_chain)


def _model(
    path: Path, config: dict | None, weights: WeightsFile, as_chain: bool, json: Path | None = None
) -> KerasModel:
    facts = config or {}
    outputs: dict[str, int] = {}
    version = weights.attribute("keras_version") or facts.get("keras_version")
    version = re.match(r"\d", str(version or ("1" if weights.is_legacy else "3")))
    backend = weights.attribute("backend") or facts.get("backend")
    if config is not None:
        root = read_architecture(config, json or path, as_chain)
        arrays = weights.arrays_of(root)
        layers = [replace(leaf, arrays=arrays.get(id(leaf), [])) for leaf in root.leaves()]
        layers, outputs = joined_outputs(layers, json or path)
    elif weights.is_legacy:
        groups = weights.named_arrays()
        layers = [KerasLayer(name, "", {}, [array for _, array in group]) for name, group in groups]
    else:
        raise InputError(
            f"{path}: holds weights without the architecture; name model.json, or save the "
            "model with model.save('model.h5')"
        )
    backend = backend if isinstance(backend, str) else ""
    number = int(version[0]) if version else 1
    return KerasModel(path, number, backend, layers, config is not None, outputs)


def _json_model(path: Path) -> dict:
    try:
        return _checked_model(read_text(path, MOST_JSON_BYTES), path)
    except ValueError as error:
        reason = " ".join(str(error).split())[:200]
        text = f"is no model of Keras ({reason}); write it with model.to_json()"
        raise _unreadable(path, text) from None


def _checked_model(contents: str, path: Path) -> dict:
    if len(contents) > MOST_JSON_BYTES:
        raise InputError(f"{path}: its architecture has {len(contents):,} characters; too many")
    model = parse_json(contents)
    if isinstance(model, str):  # json.dump(model.to_json(), file), a frequent mistake
        model = parse_json(model)
    check_text(_without_code(model))
    if not isinstance(model, dict):
        raise ValueError("its architecture is not a model")
    return model


def _without_code(node: object, depth: int = 0) -> object:
    """Return a config without the code of Lambdas, the only text that may contain NUL."""
    if depth > MOST["levels"]:
        raise ValueError(f"nested deeper than {MOST['levels']} levels")
    if isinstance(node, dict):
        return {
            k: None if k == "function" else _without_code(v, depth + 1) for k, v in node.items()
        }
    return [_without_code(child, depth + 1) for child in node] if isinstance(node, list) else node


def _weights_of(path: Path) -> Path:
    """Return the weights file in the folder of a `.json` file."""
    stem = path.stem
    usual = (stem, f"{stem}.weights", f"{stem}_weights", f"{stem}-weights", "model", "weights")
    files = [h5 for h5 in sorted(path.parent.glob("*")) if h5.suffix.lower() in WHOLE_SUFFIXES]
    files = [file for file in files if network_kind(file) != KERAS]
    paths = [file for name in usual for file in files if file.stem == name][:1] or files
    if len(paths) == 1:
        return paths[0]
    raise InputError(
        f"{path}: its weights are in a .h5 file, and there are {len(paths)} in its folder; set "
        f"weights=FILE.h5, or name it {stem}.h5"
    )


def _json_of(path: Path) -> Path | None:
    stems = (path.stem, path.stem.removesuffix(".weights"), path.stem.removesuffix("_weights"))
    names = (*(f"{stem}.json" for stem in stems), "model.json")
    return next((file for name in names if (file := path.with_name(name)).is_file()), None)


def _member(archive: zipfile.ZipFile, name: str, path: Path) -> bytes:
    """Return a member of an archive, of the size that the archive claims."""
    try:
        info = archive.getinfo(name)
    except KeyError:
        raise InputError(f"{path}: lacks {name}; save the model with model.save again") from None
    if name != WEIGHTS and info.file_size > MOST_JSON_BYTES:
        raise InputError(
            f"{path}: {name} claims {info.file_size:,} bytes; the limit is {MOST_JSON_BYTES:,}"
        )
    with archive.open(info) as member:
        return member.read(info.file_size)


@contextmanager
def _naming_damage(path: Path, kind: str) -> Iterator[Any]:
    """Yield the class of an HDF5 file; report any error of reading a damaged one in one line."""
    with optional_import(f"{path}: h5py, which reads it, is not installed; pip install h5py"):
        import h5py
    try:
        yield h5py.File
    except (InputError, MemoryError):
        raise
    except Exception as error:  # h5py, zipfile and json raise any error on damaged bytes
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())[:200]
        text = f"is not a complete {kind} file of Keras ({reason}); copy it again"
        raise _unreadable(path, text) from None


def check_exists(path: Path) -> None:
    """Raise InputError if there is no such file."""
    if not path.exists():
        raise InputError(f"{path}: no such file; correct the path")


def _unreadable(path: Path, text: str) -> InputError:
    """Return the error about a file of another kind, or else `text`."""
    check_exists(path)
    kind = network_kind(path)
    is_other = kind and kind not in IMPORTED
    return InputError(f"{path}: {describe_kind(path, kind) if is_other else text}")
