"""VGG16's public weights, trained on ImageNet: downloaded on first use, checked by their hash."""

import hashlib
from http.client import HTTPException
from pathlib import Path

import torch

from datamodules.errors import InputError

URL = "https://download.pytorch.org/models/vgg16-397923af.pth"
SHA256_START = "397923af"  # which the file's name carries too


def imagenet_file(
    url: str = URL, sha256_start: str = SHA256_START, folder: Path | None = None
) -> Path:
    """The file of weights, downloaded to torch's own cache where it is not there yet.

    Args:
        folder: where it is kept; None for torch's (`TORCH_HOME`, else `~/.cache/torch`).

    Raises:
        InputError: it is not there and cannot be downloaded, or is not what it should be.
    """
    folder = folder or Path(torch.hub.get_dir()) / "checkpoints"
    path = folder / url.rpartition("/")[2]
    if not path.is_file():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            # Under its name only when whole and checked: torch sees to both.
            torch.hub.download_url_to_file(url, str(path), sha256_start)
        except (OSError, RuntimeError, HTTPException) as error:
            reason = " ".join(str(error).split())
            raise InputError(
                f"{path} is missing and was not downloaded ({reason}): fetch {url}, put it "
                "there or name it, model.weights=FILE; or model.weights=null for random ones"
            ) from None
        return path
    # A second over 528 MB, beside the minutes of any training with this network.
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    if not digest.hexdigest().startswith(sha256_start):
        raise InputError(f"{path}: is not the file of {url} (another hash); delete it")
    return path
