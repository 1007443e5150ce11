"""`drivezoo leaderboard`: rank all runs, the best driver first."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.command import command
from zoo.base.entry_points import installed_entries, load_entry
from zoo.base.errors import InputError, UsageError
from zoo.base.output_files import OUTPUTS
from zoo.base.terminal import command_line, counted
from zoo.runs.table_files import TableFiles

if TYPE_CHECKING:
    from zoo.results.ranking_page import Ranking

    # Takes a ranking, the folder and the typed command; returns files, and lines to print.
    PaperWriter = Callable[[Ranking, str | Path, str], tuple[list[Path], list[str]]]
PAGE = "leaderboard.html"
PAPERS = "drivezoo.papers"  # entry points of what writes the files of `paper=`


@command(outputs=True)
def leaderboard(
    *folder: str | Path, paper: str | Path | None = None, tables: TableFiles
) -> "Ranking":
    """Rank all runs, the best driver first.

    Prints the ranking and writes it as a page, leaderboard.html, into the first folder, unless
    `paper=` is given. In a folder without runs, ranks evaluations and benchmarks, the `out=` of
    drivezoo evaluate and drivezoo benchmark, and drives: outputs/drives has those of drivezoo
    drive. Drives of less than a lap come last, with their length.

    Args:
        *folder: folders that contain runs, sweeps or drives; default: outputs.
        paper: folder for a paper: tables, plots, the commands, and an archive that repeats them;
            needs results of drivezoo benchmark, or trainings.
        tables: see `TableFiles`.

    Raises:
        InputError: a folder does not exist, or contains neither runs nor drives; or see
            `paper_writers`.
    """
    from zoo.results.ranking_page import Ranking
    from zoo.results.scored import drive_folders, run_folders

    named = [Path(name) for name in folder]
    roots = named or [OUTPUTS]
    for root in roots:
        if not root.is_dir():
            raise InputError(f"{root}: no such folder; usage: {leaderboard.usage}")
    folders, drives = (  # each once, by whatever paths it is named
        sorted({path.resolve(): path for root in within for path in find(root)}.values())
        for find, within in ((run_folders, roots), (drive_folders, named))
    )
    if not folders and not drives:
        raise InputError(
            f"{', '.join(map(str, roots))}: no runs found; train one: drivezoo train, or rank "
            "what drivezoo evaluate wrote: drivezoo leaderboard outputs/evaluations"
        )
    tables.check_files(inputs=[*folders, *drives])
    writers = [] if paper is None else [(write, paper) for write in paper_writers(paper)]
    title = f"leaderboard of {', '.join(map(str, roots))}: {counted(len(folders), 'run')}"
    title += f"; evaluations, benchmarks or drives: {len(drives)}" if drives else ""
    ranking = Ranking.read(folders, roots[0] if len(roots) == 1 else Path(), drives, title)
    if paper is None:
        ranking.written.append(ranking.write_page(roots[0] / PAGE, "Leaderboard"))
    ranking.written.extend(tables.write_files(ranking))
    for write_paper, out in writers:
        words = ["drivezoo", "leaderboard", *roots, f"paper={out}"]
        written, notes = write_paper(ranking, out, command_line(words))
        ranking.written.extend(written)
        ranking.notes.extend(notes)
    return ranking


def paper_writers(out: str | Path) -> list["PaperWriter"]:
    """Return the functions of extras and installed packages that write a paper's files.

    Raises:
        UsageError: there is none.
        InputError: a package's function cannot be imported.
    """
    # Ours comes first, and makes the folder.
    if writers := [load_entry(entry, Callable) for entry in installed_entries(PAPERS)]:
        return writers
    raise UsageError(f"paper={out}: nothing that is installed writes papers; leave it out")


if __name__ == "__main__":
    leaderboard.run()
