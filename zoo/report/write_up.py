"""Write a run's report as HTML and Markdown from the same sections."""

from collections.abc import Callable, Sequence
from pathlib import Path

from zoo.base.errors import InputError
from zoo.base.whole_file import refuse_links_out, write_whole
from zoo.report import (
    card_section,
    data_section,
    drive_section,
    headline,
    network_section,
    training_section,
)
from zoo.report.blocks import Block, Missing, Section, images_of, to_html, to_markdown
from zoo.report.reported_run import ReportedRun

FOLDER, PAGE, MARKDOWN = "report", "index.html", "report.md"
Part = Callable[[ReportedRun], list[Block]]
SECTIONS: dict[str, Sequence[Part]] = {
    "Headline": (headline.headline,),
    # With the film, which readers look for.
    "Driving": (drive_section.scores, drive_section.tracks),
    "Data": (
        data_section.recordings,
        data_section.split,
        data_section.balance,
        data_section.cameras,
        data_section.flipped,
        data_section.recovery,
        data_section.fed,
    ),
    "Network": (network_section.layers_table,),
    "Training": (training_section.duration, training_section.curves),
    "Open loop": (training_section.open_loop, training_section.scatter),
    "Settings": (card_section.command, card_section.settings),
    "Model card": (card_section.use, card_section.limits),
}


def write_report(folder: Path) -> Path:
    """Write the report of a finished or unfinished run in its folder, and return the page's path.

    A missing part is replaced by a line with the reason.

    Raises:
        InputError: the folder is not a run's, a link in it leads out of it, or the report cannot
            be written.
    """
    run, place = ReportedRun.open(Path(folder)), Path(folder) / FOLDER
    refuse_links_out(run.folder)
    sections = [Section(name, _blocks(run, parts)) for name, parts in SECTIONS.items()]
    versions, when = run.metrics.get("versions") or {}, run.status.get("time") or ""
    title, footer = headline.title(run), f"drivezoo {versions.get('drivezoo') or ''} {when[:10]}"
    try:
        place.mkdir(exist_ok=True)
        for section in sections:
            for image in images_of(section.blocks):
                write_whole(place / image.name, image.data)
        write_whole(place / MARKDOWN, to_markdown(title, sections))
        return write_whole(place / PAGE, to_html(title, sections, footer))
    except OSError as error:
        raise InputError(f"{place}: cannot be written ({error.strerror or error})") from None


def _blocks(run: ReportedRun, parts: Sequence[Part]) -> list[Block]:
    """Return the blocks of a section; a part that cannot be created becomes a line, once."""
    blocks: list[Block] = []
    for part in parts:
        try:
            blocks += part(run)
        except (InputError, OSError) as error:
            line = Missing(str(error))
            blocks += [] if line in blocks else [line]
        # A run of another version may hold anything; a report must not stop a training.
        except Exception as error:
            reason = " ".join([f"{type(error).__name__}:", *str(error).splitlines()[:1]])
            blocks.append(Missing(f"This part could not be written ({reason})."))
    return blocks
