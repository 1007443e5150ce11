"""`drivezoo convert SOURCE [key=value ...]`: exchange recordings with LeRobot and Donkeycar.

Finds out what SOURCE is: a recording, a LeRobotDataset v3 or a Donkeycar tub. Writes a recording as
a dataset or a tub, and a dataset or a tub as a recording that every command takes.

  drivezoo convert FOLDER to=lerobot out=NEW
  drivezoo convert TUB out=NEW
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from zoo.base.errors import UsageError
from zoo.base.terminal import command_line, printable
from zoo.cli.closing_lines import print_next, print_written
from zoo.cli.command import Command
from zoo.cli.run_command import run_command

if TYPE_CHECKING:
    from collections.abc import Callable

    from datamodules.formats.recording_writer import Converted

COMMAND = Command(__doc__, {"SOURCE": "folder of a recording, a LeRobot dataset or a tub"})


@dataclass(frozen=True, kw_only=True)
class ConvertOptions:
    """Options of the command; `conf/convert.yaml` has their meanings and defaults."""

    to: Literal["udacity", "lerobot", "donkeycar"] | None
    out: Path | None
    images: str | None
    fps: Annotated[int, Field(ge=1, le=1000)] | None
    crf: Annotated[int, Field(ge=1, le=51)]
    task: str
    steering: str | None
    camera: str | None
    speed_unit: Literal["mph", "mps", "kmh"]
    fit: Literal["keep", "pad"]
    on_bad_row: Literal["fail", "skip"]
    quality: Annotated[int, Field(ge=1, le=100)]


def convert(arguments: list[str]) -> None:
    """Convert a folder, and print what was written and what was lost.

    Raises:
        InputError: the source cannot be read, or the new folder cannot be written.
        UsageError: the formats do not fit, or a value is wrong.
    """
    (named,), options = COMMAND.read(arguments, ConvertOptions)
    from rich.console import Console

    from datamodules.recording import find_format, formats
    from zoo.base.new_folder import free_folder, print_unfinished, refuse_existing
    from zoo.cli.console_progress import progress_bar

    source = Path(named).expanduser()
    found, _ = find_format(source)
    to = target_format(named, found, options.to)
    folder = source.parent if source.is_file() else source
    # Without SOURCE's own name, `.` has none to add the format to.
    whole = folder.absolute()
    out = options.out or free_folder(whole.with_name(f"{whole.name}_{to}"))
    refuse_existing(out.expanduser())
    print_unfinished(out)
    with progress_bar("converting", Console(stderr=True)) as report:
        result = run_conversion(source, out, to, options, report)
    drives = f"{result.drives:,} continuous drive{'' if result.drives == 1 else 's'}"
    titles = {name: known.title for name, known in formats()}
    print(f"{titles[found]} -> {titles[to]}: {result.rows:,} rows, {drives}")
    for note in result.notes:
        print(printable(f"- {note}"))
    print_written([result.folder])
    print_following(result, to)


def target_format(named: str, found: str, to: str | None) -> str:
    """Return the format to write.

    Raises:
        UsageError: there is nothing to convert, or one of the formats must be a recording.
    """
    if to is None and found == "udacity":
        raise UsageError(
            f"{named}: is a recording; name its new format: to=lerobot or to=donkeycar"
        )
    from datamodules.recording import formats

    to, title = to or "udacity", dict(formats())[found].title
    if to == found:
        raise UsageError(f"to={to}: {named} is a {title} already; name another format")
    if "udacity" not in (to, found):
        raise UsageError(
            f"to={to}: a {title} becomes a recording first: leave out to=, then convert the "
            "new folder"
        )
    return to


def run_conversion(
    source: Path,
    out: Path,
    to: str,
    options: ConvertOptions,
    progress: "Callable[[float], None]",
) -> "Converted":
    """Convert between two formats, of which one is a recording; return the result."""
    from datamodules.recording import ReadOptions, read_recordings

    if to == "udacity":
        from datamodules.formats.recording_writer import convert_to_recording

        given = {key: getattr(options, key) for key in ("steering", "camera", "speed_unit")}
        read = ReadOptions(options.images, on_bad_row=options.on_bad_row, **given)
        return convert_to_recording(
            source, out, read, fit=options.fit, quality=options.quality, progress=progress
        )
    from datamodules.recording_report import skipped_lines

    recording = read_recordings(
        str(source), options.images, on_bad_image="skip", on_bad_row=options.on_bad_row
    )
    if to == "donkeycar":
        from datamodules.formats.tub_export import export_tub

        result = export_tub(recording, out, progress)
    else:
        from datamodules.formats.lerobot_export import export_lerobot

        result = export_lerobot(recording, out, options.fps, options.crf, options.task, progress)
    return replace(result, notes=(*skipped_lines(recording), *result.notes))


def print_following(result: "Converted", to: str) -> None:
    """Print the command that uses what was written."""
    folder = str(result.folder)
    if to == "udacity":
        print_next(command_line(["drivezoo", "check", folder]))
    elif to == "donkeycar":
        print_next(command_line(["donkey", "train", "--tub", folder]), "in your car's folder")
    else:
        name = f"local/{result.folder.name}"
        words = ["lerobot-dataset-viz", "--repo-id", name, "--root", folder, "--episode-index", "0"]
        print_next(command_line(words), "where LeRobot is installed")


if __name__ == "__main__":
    sys.exit(run_command("zoo.convert", convert, sys.argv[1:]))
