"""`drivezoo convert`: exchange recordings with LeRobot, Donkeycar and others."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Field

from datamodules.read_options import ReadOptions
from zoo.base.command import command
from zoo.base.errors import UsageError
from zoo.base.terminal import command_line, counted, print_next, print_written, printable

Written = Literal["udacity", "lerobot", "donkeycar", "shards"]


@command
def convert(
    source: str,
    *sources: str,
    to: Written | None = None,
    out: Path | None = None,
    fps: Annotated[int, Field(ge=1, le=1000)] | None = None,
    crf: Annotated[int, Field(ge=1, le=51)] = 18,
    task: str = "follow the road",
    fit: Literal["keep", "pad"] = "keep",
    quality: Annotated[int, Field(ge=1, le=100)] = 95,
    shard_mb: Annotated[float, Field(gt=0, le=4000)] = 128,
    read: ReadOptions,
) -> Path:
    """Write a recording as Udacity's log, a LeRobot dataset, a Donkeycar tub, or shards.

    Finds out by its files what SOURCE is. Several become one dataset, tub, or folder of shards.

      drivezoo convert FOLDER to=lerobot out=NEW
      drivezoo convert TUB out=NEW

    Args:
        source: folder or file of a recording, or address of shards.
        *sources: further ones.
        to: new format; null: udacity (driving_log.csv), for a folder of another format.
        out: new folder to write; null: SOURCE's name with the format, with a number if that exists.
        fps: LeRobot: frames per second to write; null: the recording's mean.
        crf: LeRobot: quality of the videos, of which 1 is the best and the largest.
        task: LeRobot: the task in words.
        fit: keep: images as they are; pad: with black bars, twice as wide as high, as the
            simulator's frames are.
        quality: quality of JPEGs written from videos or padded.
        shard_mb: shards: MB of each.
        read: see `ReadOptions`.

    Raises:
        InputError: the source cannot be read, or the new folder cannot be written.
        UsageError: the formats do not fit, or a value is wrong.
    """
    from rich.console import Console

    from datamodules.recording_format import find_format, formats
    from zoo.base.console_progress import progress_bar
    from zoo.base.new_folder import free_folder, refuse_existing

    place = Path(source).expanduser()
    found, _ = find_format(place, read.format)
    titles = {name: known.title for name, known in formats().items()}
    to = to or "udacity"
    if to == found:
        *others, last = (f"to={name}" for name in get_args(Written) if name != found)
        raise UsageError(
            f"to={to}: {source} is a {titles[to]} already; name another format: "
            f"{', '.join(others)} or {last}"
        )
    if to == "udacity" and sources:
        raise UsageError("to=udacity: takes one recording; convert each, and name all in data.root")
    # Without SOURCE's own name, `.` has none to add the format to.
    whole = (place.parent if place.is_file() else place).absolute()
    out = out or free_folder(whole.with_name(f"{whole.name}_{to}"))
    refuse_existing(out.expanduser())
    with progress_bar("converting", Console(stderr=True)) as report:
        if to == "udacity":
            from datamodules.formats.recording_writer import convert_to_recording

            result = convert_to_recording(
                place, out, read, fit=fit, quality=quality, progress=report
            )
            words, purpose = ["drivezoo", "check", str(result.folder)], ""
        else:
            from datamodules.looking.findings import skipped_lines
            from datamodules.recording_format import read_recordings

            roots = [source, *sources]
            recording = read_recordings(roots, **{**asdict(read), "on_bad_image": "skip"})
            if to == "shards":
                from datamodules.formats.shards import export_shards

                result = export_shards(recording, out, shard_mb, quality, report)
                words, purpose = ["drivezoo", "train", f"data.root={result.folder}"], ""
            elif to == "donkeycar":
                from datamodules.formats.donkeycar import export_tub

                result = export_tub(recording, out, report)
                words = ["donkey", "train", "--tub", str(result.folder)]
                purpose = "in your car's folder"
            else:
                from datamodules.formats.lerobot_export import export_lerobot

                result = export_lerobot(recording, out, fps, crf, task, report)
                name = f"local/{result.folder.name}"
                words = ["lerobot-dataset-viz", "--repo-id", name, "--root", str(result.folder)]
                words += ["--episode-index", "0"]
                purpose = "where LeRobot is installed"
            result = replace(result, notes=(*skipped_lines(recording), *result.notes))
    drives = counted(result.drives, "continuous drive")
    print(f"{titles[found]} -> {titles[to]}: {counted(result.rows, 'row')}, {drives}")
    for note in result.notes:
        print(printable(f"- {note}"))
    print_written([result.folder])
    print_next(command_line(words), purpose)
    return result.folder


if __name__ == "__main__":
    convert.run()
