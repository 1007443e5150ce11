"""Guard files: a fitted score and its threshold, in plain containers."""

import io
from dataclasses import dataclass
from pathlib import Path

import torch

from zoo.base.bounded_files import check_version
from zoo.base.errors import InputError
from zoo.base.regular_file import hash_file
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint import FORMAT, load_plain
from zoo.monitor import MOST_SAMPLES
from zoo.monitor.scores import METHODS, Score, make_score
from zoo.monitor.signals import IMAGE

KEY = "drivezoo_guard"
REMEDY = "name a file of drivezoo guard"


@dataclass(frozen=True)
class Guard:
    """A score, its threshold and what happens above it.

    Attributes:
        score: fitted method.
        threshold: mean score of a window above which the guard fires.
        window: number of frames in a window.
        limit_mph: speed to slow down to while it fires.
        samples: passes of Monte-Carlo dropout for each frame.
        sha256: hash of the checkpoint that drove the nominal drives.
    """

    score: Score
    threshold: float
    window: int
    limit_mph: float
    samples: int
    sha256: str


def write_guard(path: Path, guard: Guard) -> Path:
    """Write a guard file and return its path."""
    contents = {key: getattr(guard, key) for key in _NUMBERS} | {
        "format": FORMAT,
        "method": guard.score.method,
        "state": guard.score.state,
        "sha256": guard.sha256,
    }
    buffer = io.BytesIO()
    torch.save({KEY: contents}, buffer)
    return write_whole(path, buffer.getbuffer())


def read_guard(path: str | Path) -> Guard:
    """Return the contents of a guard file; no code in it is run.

    Raises:
        InputError: the file cannot be read, is no guard file, or a value in it is wrong.
    """
    path = Path(path).expanduser()
    found = load_plain(path)
    found = found.get(KEY) if isinstance(found, dict) else None
    if not isinstance(found, dict):
        raise InputError(f"guard={path}: is not a guard file; {REMEDY}")
    remedy = "fit it again with drivezoo guard"
    check_version(found.get("format"), FORMAT, f"guard={path}", remedy)
    for key, (kind, most) in _NUMBERS.items():
        value = found.get(key)
        if isinstance(value, bool) or not isinstance(value, kind) or not 0 < value <= most:
            raise InputError(
                f"guard={path}: {key}: is {' '.join(repr(value).split()):.40}; {REMEDY}"
            )
    method, sha256 = found.get("method"), str(found.get("sha256"))
    if not isinstance(method, str) or method not in METHODS:
        raise InputError(f"guard={path}: method: is {' '.join(repr(method).split()):.40}; {REMEDY}")
    try:
        score = make_score(method, found["state"])
    except (
        KeyError,
        TypeError,
        ValueError,
        ArithmeticError,
        RuntimeError,
        AttributeError,
    ) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"guard={path}: state: is damaged ({reason}); {REMEDY}") from None
    return Guard(score, **{key: found[key] for key in _NUMBERS}, sha256=sha256)


def check_checkpoint(path: str | Path, guard: Guard, checkpoint: str | Path) -> None:
    """Check that a guard was fitted with a checkpoint.

    A score of the camera's images alone, such as the autoencoder's, fits every checkpoint.

    Raises:
        InputError: the guard's scores are those of another network.
    """
    if METHODS[guard.score.method].signal == IMAGE:
        return
    if hash_file(checkpoint) != guard.sha256:
        raise InputError(
            f"guard={path}: was fitted with another checkpoint than {checkpoint}; run "
            "drivezoo guard with this one"
        )


# Type and largest value of each number.
_NUMBERS = {
    "threshold": (float, 1e9),
    "window": (int, 100_000),
    "limit_mph": (float, 100.0),
    "samples": (int, MOST_SAMPLES),
}
