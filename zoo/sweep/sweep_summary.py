"""The summary of a finished sweep: the ranking of its jobs, and the jobs that failed."""

from pathlib import Path

from rich.console import Console

from zoo.base.errors import InputError
from zoo.cli.closing_lines import print_written
from zoo.leaderboard.ranking_page import write_page
from zoo.leaderboard.ranking_table import Ranking, following, print_ranking
from zoo.sweep.sweep_record import job_folders

PAGE = "ranking.html"


def conclude(folder: Path, console: Console) -> None:
    """Print the ranking of a sweep's jobs and write its page.

    Raises:
        InputError: jobs failed; the message has each job's reason.
    """
    folders = job_folders(folder)
    title = f"{len(folders)} jobs, the best driver first"
    ranking = Ranking.read(folders, folder)
    entries, unranked = ranking.entries, ranking.unranked
    print_ranking(ranking, title, console, PAGE)
    page = write_page(folder / PAGE, f"Sweep {folder.name}", entries, unranked, folder)
    print_written([page], following(entries), console)
    failed = [one for one in unranked if one.why in ("failed", "stopped")]
    if failed:
        reasons = "; ".join(f"{one.folder.name}: {one.reason or 'it was killed'}" for one in failed)
        raise InputError(
            f"{len(failed)} of {len(folders)} jobs failed: {reasons}; the same command runs them "
            "again"
        )
