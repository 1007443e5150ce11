"""Find the recordings of runs, and give each a short unique name."""

import os
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class TrainedOn:
    """The recordings that a run was trained on.

    Attributes:
        roots: folders of the recordings, absolute.
        fingerprint: fingerprint of the rows; empty in runs of earlier versions.
    """

    roots: tuple[str, ...] = ()
    fingerprint: str = ""


def read_trained_on(config: dict, started_in: str | None, metrics: dict) -> TrainedOn:
    """Return the recordings of a run from its config and metrics."""
    data = config.get("data") or {}
    # data=lake names no root: the run records into data.record.out.
    root = data.get("root") or (data.get("record") or {}).get("out") or []
    cwd = Path(started_in or "")
    roots = [root] if isinstance(root, str) else root
    found = tuple(os.path.normpath(cwd / os.path.expanduser(one)) for one in roots)  # noqa: PTH111
    return TrainedOn(found, str((metrics.get("data") or {}).get("fingerprint") or ""))


def recording_names(recordings: Sequence[TrainedOn]) -> dict[TrainedOn, str]:
    """Return a name for each: its folders, with the shortest end of the path that is unique.

    If the folders are equal, the first digits of the fingerprint follow.

    >>> old, new = TrainedOn(("/a/lake",), "0123456789"), TrainedOn(("/a/lake",), "abcdef0123")
    >>> list(recording_names([old, new, TrainedOn(("/b/lake",))]).values())
    ['a/lake (012345)', 'a/lake (abcdef)', 'b/lake']
    """
    roots = {root for one in recordings for root in one.roots}
    labels = {root: _end_of_path(root, roots) for root in roots}
    names = {}
    for one in recordings:
        name = ", ".join(labels[root] for root in one.roots) or "-"
        same = {other.fingerprint for other in recordings if other.roots == one.roots}
        names[one] = f"{name} ({one.fingerprint[:6] or 'not known'})" if len(same) > 1 else name
    return names


def _end_of_path(root: str, roots: Collection[str]) -> str:
    """Return the shortest end of a path that no other path has."""
    parts = Path(root).parts
    for count in range(1, len(parts)):
        end = parts[-count:]
        if sum(Path(one).parts[-count:] == end for one in roots) == 1:
            return "/".join(end)
    return root
