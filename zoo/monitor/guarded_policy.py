"""Guard files, a fitted score and its threshold in plain containers; and the policy they watch."""

import io
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from zoo.base.bounded_files import check_version, hash_file
from zoo.base.errors import InputError
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint import FORMAT, load_plain
from zoo.checkpoints.command import Command, Policy, PolicyWrapper
from zoo.monitor import MOST_SAMPLES
from zoo.monitor.scores import METHODS, Score, make_score
from zoo.monitor.signals import IMAGE, make_source

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
        LookupError,
        TypeError,
        ValueError,
        ArithmeticError,
        RuntimeError,
        AttributeError,
    ) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
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


class GuardedPolicy(PolicyWrapper):
    """Policy that sets a speed limit while its guard fires.

    The guard fires while the mean score of the last window of frames is above the threshold. It
    does not change the steering.

    Args:
        policy: policy that drives.
        guard: guard that watches.
    """

    def __init__(self, policy: Policy, guard: Guard) -> None:
        super().__init__(policy)
        self.guard, self._alarms = guard, [0]
        self._source = make_source(METHODS[guard.score.method].signal, policy, guard.samples)
        self._begin()

    def _begin(self) -> None:
        guard = self.guard
        self._signals: deque[Any] = deque(maxlen=METHODS[guard.score.method].frames)
        self._scores: deque[float] = deque(maxlen=guard.window)
        self.fires = False

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the policy's command for a frame, with a speed limit while the guard fires."""
        command = self.policy(frame, speed_mph)
        self._signals.append(self._source(frame, speed_mph, command))
        self._scores.append(float(self.guard.score(np.array(self._signals))[-1]))
        whole = len(self._scores) == self.guard.window
        fires = whole and float(np.mean(self._scores)) > self.guard.threshold
        self._alarms[0] += fires and not self.fires
        self.fires = fires
        return replace(command, limit_mph=self.guard.limit_mph) if fires else command

    @property  # type: ignore[override]
    def alarms(self) -> int:
        """Return how often the guard has begun to fire, in all sessions."""
        return self._alarms[0]

    def reset(self) -> None:
        """Forget the frames before."""
        super().reset()
        self._begin()

    def session(self) -> "GuardedPolicy":
        """Return the policy for one more car, with a window of its own."""
        other = super().session()
        other._begin()
        return other


def guarded(policy: Policy, checkpoint: str | Path, guard: str | Path) -> GuardedPolicy:
    """Return a policy that the guard of a file watches.

    Args:
        policy: policy that drives.
        checkpoint: file that the policy was loaded from.
        guard: path of the guard file.

    Raises:
        InputError: see `read_guard`; or the guard was fitted with another checkpoint.
    """
    found = read_guard(guard)
    check_checkpoint(guard, found, checkpoint)
    return GuardedPolicy(policy, found)
