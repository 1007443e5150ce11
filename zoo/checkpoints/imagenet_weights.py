"""Download VGG16's public ImageNet weights on first use, and check their hash."""

import hashlib
from http.client import HTTPException
from pathlib import Path

import torch

from datamodules.errors import InputError

URL = "https://download.pytorch.org/models/vgg16-397923af.pth"
SHA256_START = "397923af"  # as in the file's name


def imagenet_file(
    url: str = URL, sha256_start: str = SHA256_START, folder: Path | None = None
) -> Path:
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
                "there, or set model.weights=FILE, or model.weights=null for random weights"
            ) from None
        return path
    # One second for 528 MB; a training of this network takes minutes.
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    if not digest.hexdigest().startswith(sha256_start):
        raise InputError(
            f"{path}: is not the file of {url} (another hash); delete it to download it again"
        )
    return path
