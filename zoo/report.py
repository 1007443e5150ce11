"""`python -m zoo.report RUN`: the write-up of a run, one page and one Markdown file.

`RUN/report/index.html` holds its pictures and its film, and fetches nothing; `RUN/report/report.md`
has its pictures beside it.
"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from datamodules.errors import InputError
from datamodules.terminal import printable
from zoo.checkpoint_path import find_run
from zoo.command_line import run_command
from zoo.console_progress import loading
from zoo.whole_file import refuse_links_out, write_whole

if TYPE_CHECKING:
    from zoo.reporting.blocks import Section
    from zoo.reporting.run import Run

FOLDER, PAGE, MARKDOWN = "report", "index.html", "report.md"
USAGE = "python -m zoo.report RUN_FOLDER"

# What a section needs takes seconds to import; --help and a typo need none of it.


def write_report(folder: Path) -> Path:
    """Write the report of a run, finished or not, in its folder; returns the page's path.

    What is missing leaves a line that says why.

    Raises:
        InputError: the folder is no run's, a link in it leads out of it, or the report cannot be
            written.
    """
    from zoo.reporting.run import read_run

    folder = Path(folder)
    run = read_run(folder)
    refuse_links_out(folder)
    try:
        return _write(run, folder / FOLDER)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{folder / FOLDER}: cannot be written ({reason})") from None


def _write(run: "Run", folder: Path) -> Path:
    from zoo.reporting.blocks import Pictures, walk
    from zoo.reporting.headline import title
    from zoo.reporting.markdown import to_markdown
    from zoo.reporting.page import to_html

    sections = report_sections(run)
    folder.mkdir(exist_ok=True)
    for section in sections:
        for block in walk(section.blocks):
            for picture in block.pictures if isinstance(block, Pictures) else ():
                write_whole(folder / picture.name, picture.data)
    name = title(run)
    write_whole(folder / MARKDOWN, to_markdown(name, sections, folder))
    page = to_html(name, sections, _footer(run), folder)
    return write_whole(folder / PAGE, page)


def report_sections(run: "Run") -> "list[Section]":
    """All sections in their order; one that fails says so in a line, and the others stand."""
    from zoo.reporting.blocks import Missing, Section
    from zoo.reporting.card import card_blocks, settings_blocks
    from zoo.reporting.data_section import data_blocks
    from zoo.reporting.drive_section import drive_blocks
    from zoo.reporting.headline import headline_blocks
    from zoo.reporting.network_section import network_blocks
    from zoo.reporting.training_section import open_loop_blocks, training_blocks

    makers = {
        "Headline": headline_blocks,
        "Data": data_blocks,
        "Network": network_blocks,
        "Training": training_blocks,
        "Open loop": open_loop_blocks,
        "The drive": drive_blocks,
        "Settings": settings_blocks,
        "Model card": card_blocks,
    }
    sections = []
    for name, make in makers.items():
        try:
            blocks = make(run)
        # A run of another version may hold anything, and a report is worth no training.
        except Exception as error:
            said = str(error).splitlines()[0] if str(error) else ""
            blocks = [Missing(f"This section cannot be made: {type(error).__name__}: {said}")]
        sections.append(Section(name, blocks))
    return sections


def _footer(run: "Run") -> str:
    version = (run.metrics.get("versions") or {}).get("drivezoo")
    when = (run.status.get("time") or "")[:10]
    return " ".join(part for part in ("drivezoo", version, when) if part)


def report(arguments: list[str]) -> None:
    """The command: a run's folder."""
    if {"-h", "--help"} & set(arguments):
        print(f"usage: {USAGE}\n\nWrites RUN_FOLDER/{FOLDER}/{PAGE} and {MARKDOWN}.")
        print("RUN_FOLDER may be latest: the newest run below outputs.")
        return
    if len(arguments) != 1:
        raise InputError(f"usage: {USAGE}")
    run = find_run(arguments[0])
    with loading("writing the report"):
        page = write_report(run)
    for path in (page, page.with_name(MARKDOWN)):
        print(printable(str(path)))


if __name__ == "__main__":
    sys.exit(run_command("zoo.report", report, sys.argv[1:]))
