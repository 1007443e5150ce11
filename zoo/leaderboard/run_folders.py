"""Folders of runs and drives below the folders that a user names."""

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from zoo.base.terminal import command_line

# Folders without runs inside; a recording would be slow to search.
SKIPPED = {"checkpoints", "plots", "drives", "recordings", "cache", "IMG", "report", "evaluation"}
OF_DRIVES = {"drives", "evaluation"}


def run_folders(roots: Iterable[Path]) -> Iterator[Path]:
    """Yield each run's folder: one with `status.json`, or with `metrics.json` and `.hydra`."""
    for root in roots:
        if (root / "status.json").is_file() or (
            (root / "metrics.json").is_file() and (root / ".hydra").is_dir()
        ):
            yield root
            continue
        yield from run_folders(_inside(root, SKIPPED))


def common_folder(roots: Sequence[Path]) -> Path:
    """Return the folder that contains all folders, the first on different drives of Windows."""
    try:
        return Path(os.path.commonpath([one.resolve() for one in roots]))
    except ValueError:
        return roots[0]


def remedy_without_runs(roots: Iterable[Path]) -> str:
    """Return what to type for folders without runs: a score of a checkpoint in them, if any."""
    for root in roots:
        for path in sorted([*root.glob("*.ckpt"), *root.glob("*.onnx")]):
            score = ["drivezoo", "evaluate", str(path), f"out=scores/{path.stem}"]
            return f"score each checkpoint: {command_line(score)}; then rank the folder scores"
    return "train one: drivezoo train"


def drive_folders(root: Path) -> list[Path]:
    """Return the folders of evaluations, benchmarks and drives below a folder without runs."""
    from zoo.leaderboard.scored import is_benchmark, is_drive, is_evaluation

    if any(run_folders([root])):
        return []
    if is_drive(root) or is_benchmark(root) or is_evaluation(root):
        return [root]
    return [one for inner in _inside(root, SKIPPED - OF_DRIVES) for one in drive_folders(inner)]


def _inside(root: Path, skipped: set[str]) -> Iterator[Path]:
    for path in root.iterdir():
        if path.is_dir() and path.name not in skipped and not path.name.startswith("."):
            yield path
