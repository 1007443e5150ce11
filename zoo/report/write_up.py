"""The pages of a report: which sections it has, and where it is written."""

from pathlib import Path
from typing import TYPE_CHECKING

from datamodules.errors import InputError
from zoo.runs.whole_file import refuse_links_out, write_whole

if TYPE_CHECKING:
    from zoo.report.blocks import Section
    from zoo.report.reported_run import Run

FOLDER, PAGE, MARKDOWN = "report", "index.html", "report.md"
# What a section needs takes seconds to import; --help and a typo need none of it.


def write_report(folder: Path) -> Path:
    """Write the report of a run, finished or not, in its folder; returns the page's path.

    What is missing leaves a line that says why.

    Raises:
        InputError: the folder is no run's, a link in it leads out of it, or the report cannot be
            written.
    """
    from zoo.report.reported_run import read_run

    folder = Path(folder)
    run = read_run(folder)
    refuse_links_out(folder)
    try:
        return _write(run, folder / FOLDER)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{folder / FOLDER}: cannot be written ({reason})") from None


def _write(run: "Run", folder: Path) -> Path:
    from zoo.report.blocks import Pictures, walk
    from zoo.report.headline import title
    from zoo.report.markdown import to_markdown
    from zoo.report.report_page import to_html

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
    from zoo.report.blocks import Missing, Section
    from zoo.report.card_section import card_blocks, settings_blocks
    from zoo.report.data_section import data_blocks
    from zoo.report.drive_section import drive_blocks
    from zoo.report.headline import headline_blocks
    from zoo.report.network_section import network_blocks
    from zoo.report.training_section import open_loop_blocks, training_blocks

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
