"""`drivezoo leaderboard [FOLDER...] [key=value ...]`: rank all runs, the best driver first.

Prints the ranking and writes it as a page, leaderboard.html, into the first folder. In a folder
without runs, ranks evaluations and benchmarks, the `out=` of drivezoo evaluate and drivezoo
benchmark, and drives: outputs/drives has those of drivezoo drive. Drives of less than a lap come
last, with their length.
"""

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.errors import InputError
from zoo.base.terminal import command_line
from zoo.cli.closing_lines import print_written
from zoo.cli.command import Command
from zoo.cli.run_command import run_command

if TYPE_CHECKING:
    from zoo.leaderboard.ranking_table import Ranking

COMMAND = Command(
    __doc__, {"[FOLDER...]": "folders that contain runs, sweeps or drives; default: outputs"}
)
OUTPUTS = Path("outputs")
PAGE = "leaderboard.html"
# Folders without runs inside; a recording would be slow to search.
SKIPPED = {"checkpoints", "plots", "drives", "recordings", "cache", "IMG", "report", "evaluation"}
OF_DRIVES = {"drives", "evaluation"}


@dataclass(frozen=True, kw_only=True)
class LeaderboardOptions:
    """Options of a leaderboard; `conf/leaderboard.yaml` has their meanings and defaults."""

    table: str | None
    columns: str | None


def leaderboard(
    names: Sequence[str | Path], options: LeaderboardOptions
) -> "tuple[Ranking, str, list[Path]]":
    """Rank every run below the folders by autonomy, then by cross-track error.

    Write the page into the first folder. In named folders without runs, rank the drives.

    Returns:
        The ranking, its title and the files written.

    Raises:
        InputError: a folder does not exist, or contains neither runs nor drives.
    """
    from zoo.leaderboard.ranking_page import write_page
    from zoo.leaderboard.ranking_table import Ranking
    from zoo.runs.table_files import check_table, write_asked

    check_table(options.table, options.columns)
    named = [Path(one) for one in names]
    roots = named or [OUTPUTS]
    for root in roots:
        if not root.is_dir():
            raise InputError(f"{root}: no such folder; usage: {COMMAND.usage}")
    folders = sorted(set(run_folders(roots)))
    drives = sorted({one for root in named for one in drive_folders(root)})
    if not folders and not drives:
        raise InputError(f"{', '.join(map(str, roots))}: no runs found; {_remedy(roots)}")
    ranking = Ranking.read(folders, _common_folder(roots), drives)
    page = write_page(
        roots[0] / PAGE, "Leaderboard", ranking.entries, ranking.unranked, ranking.under
    )
    title = f"leaderboard of {', '.join(map(str, roots))}: {len(folders)} runs"
    title += f", {len(drives)} evaluations, benchmarks or drives" if drives else ""
    return ranking, title, [page, *write_asked(ranking, options.table, columns=options.columns)]


def show_leaderboard(arguments: list[str]) -> None:
    """Read the arguments, rank the runs and print the ranking."""
    names, options = COMMAND.read(arguments, LeaderboardOptions)
    from zoo.leaderboard.ranking_table import following, print_ranking, wide_console

    console = wide_console()
    ranking, title, written = leaderboard(names, options)
    print_ranking(ranking, title, console, PAGE)
    print_written(written, following(ranking.entries), console)


def run_folders(roots: Iterable[Path]) -> Iterator[Path]:
    """Yield each run's folder: one with `status.json`, or with `metrics.json` and `.hydra`."""
    for root in roots:
        if (root / "status.json").is_file() or (
            (root / "metrics.json").is_file() and (root / ".hydra").is_dir()
        ):
            yield root
            continue
        yield from run_folders(_inside(root, SKIPPED))


def _common_folder(roots: Sequence[Path]) -> Path:
    """Return the folder that contains all folders, the first on different drives of Windows."""
    try:
        return Path(os.path.commonpath([one.resolve() for one in roots]))
    except ValueError:
        return roots[0]


def _remedy(roots: Iterable[Path]) -> str:
    """Return what to type for folders without runs: a score of a checkpoint in them, if any."""
    for root in roots:
        for path in sorted([*root.glob("*.ckpt"), *root.glob("*.onnx")]):
            score = ["drivezoo", "evaluate", str(path), f"out=scores/{path.stem}"]
            return f"score each checkpoint: {command_line(score)}; then rank the folder scores"
    return "train one: drivezoo train"


def drive_folders(root: Path) -> list[Path]:
    """Return the folders of evaluations, benchmarks and drives below a folder without runs."""
    from zoo.leaderboard.ranked_drive import is_benchmark, is_drive, is_evaluation

    if any(run_folders([root])):
        return []
    if is_drive(root) or is_benchmark(root) or is_evaluation(root):
        return [root]
    return [one for inner in _inside(root, SKIPPED - OF_DRIVES) for one in drive_folders(inner)]


def _inside(root: Path, skipped: set[str]) -> Iterator[Path]:
    for path in root.iterdir():
        if path.is_dir() and path.name not in skipped and not path.name.startswith("."):
            yield path


if __name__ == "__main__":
    sys.exit(run_command("zoo.leaderboard", show_leaderboard, sys.argv[1:]))
