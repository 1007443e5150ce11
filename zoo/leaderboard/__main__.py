"""`drivezoo leaderboard`: rank all runs, the best driver first."""

from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.command import command
from zoo.base.errors import InputError
from zoo.runs.result_files import TableFiles

if TYPE_CHECKING:
    from zoo.leaderboard.ranking_page import Ranking

OUTPUTS = Path("outputs")
PAGE = "leaderboard.html"


@command
def leaderboard(*folder: str | Path, tables: TableFiles) -> "Ranking":
    """Rank all runs, the best driver first.

    Prints the ranking and writes it as a page, leaderboard.html, into the first folder. In a folder
    without runs, ranks evaluations and benchmarks, the `out=` of drivezoo evaluate and drivezoo
    benchmark, and drives: outputs/drives has those of drivezoo drive. Drives of less than a lap
    come last, with their length.

    Args:
        *folder: folders that contain runs, sweeps or drives; default: outputs.
        tables: see `TableFiles`.

    Raises:
        InputError: a folder does not exist, or contains neither runs nor drives.
    """
    from zoo.leaderboard.ranking_page import Ranking, write_page
    from zoo.leaderboard.run_folders import (
        common_folder,
        drive_folders,
        remedy_without_runs,
        run_folders,
    )
    from zoo.runs.table_files import check_table, write_asked

    check_table(tables.table, tables.columns)
    named = [Path(name) for name in folder]
    roots = named or [OUTPUTS]
    for root in roots:
        if not root.is_dir():
            raise InputError(f"{root}: no such folder; usage: {leaderboard.usage}")
    folders = sorted(set(run_folders(roots)))
    drives = sorted({path for root in named for path in drive_folders(root)})
    if not folders and not drives:
        raise InputError(
            f"{', '.join(map(str, roots))}: no runs found; {remedy_without_runs(roots)}"
        )
    title = f"leaderboard of {', '.join(map(str, roots))}: {len(folders)} runs"
    title += f", {len(drives)} evaluations, benchmarks or drives" if drives else ""
    ranking = Ranking.read(folders, common_folder(roots), drives, title)
    ranking.written.append(
        write_page(roots[0] / PAGE, "Leaderboard", ranking.entries, ranking.unranked, ranking.under)
    )
    ranking.written.extend(write_asked(ranking, tables.table, columns=tables.columns))
    return ranking


if __name__ == "__main__":
    leaderboard.run()
