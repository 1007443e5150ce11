"""Write a run's report as HTML and Markdown from the same sections."""

from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.errors import InputError
from zoo.base.whole_file import refuse_links_out, write_whole

if TYPE_CHECKING:
    from zoo.report.blocks import Section
    from zoo.report.reported_run import ReportedRun

FOLDER, PAGE, MARKDOWN = "report", "index.html", "report.md"
# The sections' imports take seconds, so functions import them: --help and a typo stay quick.


def write_report(folder: Path) -> Path:
    """Write the report of a finished or unfinished run in its folder, and return the page's path.

    A missing part is replaced by a line with the reason.

    Raises:
        InputError: the folder is not a run's, a link in it leads out of it, or the report cannot
            be written.
    """
    from zoo.report.reported_run import ReportedRun

    folder = Path(folder)
    run = ReportedRun.open(folder)
    refuse_links_out(folder)
    try:
        return _write(run, folder / FOLDER)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{folder / FOLDER}: cannot be written ({reason})") from None


def _write(run: "ReportedRun", folder: Path) -> Path:
    from zoo.report.blocks import images_of, to_html, to_markdown
    from zoo.report.headline import title

    sections = report_sections(run)
    folder.mkdir(exist_ok=True)
    for section in sections:
        for image in images_of(section.blocks):
            write_whole(folder / image.name, image.data)
    name = title(run)
    write_whole(folder / MARKDOWN, to_markdown(name, sections, folder))
    page = to_html(name, sections, _footer(run), folder)
    return write_whole(folder / PAGE, page)


def report_sections(run: "ReportedRun") -> "list[Section]":
    """Return all sections in order; a section that fails becomes a line with the error."""
    from zoo.report.blocks import Missing, Section
    from zoo.report.card_section import card_blocks, settings_blocks
    from zoo.report.data_section import data_blocks
    from zoo.report.drive_section import drive_blocks
    from zoo.report.headline import headline_blocks
    from zoo.report.network_section import network_blocks
    from zoo.report.training_section import open_loop_blocks, training_blocks

    makers = {
        "Headline": headline_blocks,
        "Driving": drive_blocks,  # with the film, which readers look for
        "Data": data_blocks,
        "Network": network_blocks,
        "Training": training_blocks,
        "Open loop": open_loop_blocks,
        "Settings": settings_blocks,
        "Model card": card_blocks,
    }
    sections = []
    for name, make in makers.items():
        try:
            blocks = make(run)
        # A run of another version may hold anything; a report must not stop a training.
        except Exception as error:
            reason = " ".join([f"{type(error).__name__}:", *str(error).splitlines()[:1]])
            blocks = [Missing(f"This section could not be written ({reason}).")]
        sections.append(Section(name, blocks))
    return sections


def _footer(run: "ReportedRun") -> str:
    version = (run.metrics.get("versions") or {}).get("drivezoo")
    when = (run.status.get("time") or "")[:10]
    return " ".join(part for part in ("drivezoo", version, when) if part)
