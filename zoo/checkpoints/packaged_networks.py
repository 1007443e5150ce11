"""Trained networks that come with drivezoo; without slow imports.

`python benchmarks/study.py pretrained` writes the files: `NAME.ckpt`, and `NAME.json` with what it
is, what it was trained on and how it drives.
"""

import functools
import json
import sys
from pathlib import Path
from typing import Any

from zoo.base.terminal import error_line

FOLDER = Path(__file__).with_name("packaged")


@functools.cache
def packaged_names() -> tuple[str, ...]:
    """Return the names of the networks."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.ckpt")))


def packaged_file(named: str | Path) -> Path | None:
    """Return the checkpoint of a network that comes with drivezoo; None for another name."""
    return FOLDER / f"{named}.ckpt" if str(named) in packaged_names() else None


def packaged_name(path: Path) -> str | None:
    """Return the name under which commands take a file; None for a file of the user's.

    A file or folder of that name in the current folder hides the network.
    """
    own = path.parent == FOLDER and packaged_file(path.stem) == path
    return path.stem if own and not Path(path.stem).exists() else None


def read_facts(name: str) -> dict[str, Any]:
    """Return the contents of a network's JSON file."""
    facts: dict[str, Any] = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return facts


@functools.cache
def note_hidden(path: Path) -> None:
    """Print once that a file or folder is used, not the network of its name."""
    kind = "folder" if path.is_dir() else "file"
    line = f"the {kind} of that name here; the network that comes with drivezoo is {FOLDER / path}"
    print(error_line(str(path), f"{line}.ckpt"), file=sys.stderr, flush=True)
