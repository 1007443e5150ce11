"""The files that a push sends: a checkpoint for driving, and its card."""

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path

from zoo.base.errors import InputError
from zoo.base.new_folder import command_folder
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint import build_checkpoint, read_checkpoint_file
from zoo.checkpoints.lean_checkpoint import checkpoint_bytes, lean_contents
from zoo.hub.card import Described, card_text
from zoo.hub.hub_options import CARD, HUB
from zoo.verdict.evidence import read_evidence


def shared_files(path: Path, repo: str | None, license_name: str | None) -> dict[str, bytes]:
    """Return the contents of the files of a checkpoint by name: the checkpoint, and its card.

    Args:
        path: checkpoint of a training.
        repo: repository that the card names; None for none.
        license_name: licence of the weights that the card names; None for none.

    Raises:
        InputError: the checkpoint cannot be loaded.
    """
    contents = read_checkpoint_file(path)
    checkpoint = build_checkpoint(contents, path)
    lean = lean_contents(contents)
    data = checkpoint_bytes(lean)
    evidence = read_evidence(path, checkpoint.config)
    name = re.sub(r"\W", "_", str(checkpoint.config["model"].get("name") or "network"))[:60]
    described = Described(
        file=f"{name}.ckpt",
        sha256=hashlib.sha256(data).hexdigest(),
        size=len(data),
        network=type(checkpoint.network).__name__,
        parameters=sum(one.numel() for one in checkpoint.network.parameters()),
        view=checkpoint.view,
        card=lean["drivezoo"],
        metrics=evidence.metrics,
        command=evidence.again({}),
        repo=repo,
        license=license_name,
    )
    return {described.file: data, CARD: card_text(described).encode()}


def write_files(files: Mapping[str, bytes], out: str) -> list[Path]:
    """Write the files to a new folder; return their paths.

    Raises:
        InputError: the folder is not empty, or cannot be written to.
    """
    with command_folder(out, HUB) as folder:
        try:
            return [write_whole(folder / name, data) for name, data in files.items()]
        except OSError as error:
            raise InputError(f"{folder}: {error.strerror}; name another folder") from None
