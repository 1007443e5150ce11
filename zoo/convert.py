"""`drivezoo convert`: exchange recordings with LeRobot and Donkeycar."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from zoo.base.command import command
from zoo.base.errors import UsageError
from zoo.base.terminal import command_line, printable
from zoo.cli.closing_lines import print_next, print_written


@command
def convert(
    source: str,
    *,
    to: Literal["udacity", "lerobot", "donkeycar"] | None = None,
    out: Path | None = None,
    images: str | None = None,
    fps: Annotated[int, Field(ge=1, le=1000)] | None = None,
    crf: Annotated[int, Field(ge=1, le=51)] = 18,
    task: str = "follow the road",
    steering: str | None = None,
    camera: str | None = None,
    speed_unit: Literal["mph", "mps", "kmh"] = "mps",
    fit: Literal["keep", "pad"] = "keep",
    on_bad_row: Literal["fail", "skip"] = "fail",
    quality: Annotated[int, Field(ge=1, le=100)] = 95,
) -> Path:
    """Exchange recordings with LeRobot and Donkeycar.

    Finds out what SOURCE is: a recording, a LeRobotDataset v3 or a Donkeycar tub. Writes a
    recording as a dataset or a tub, and a dataset or a tub as a recording that every command takes.

      drivezoo convert FOLDER to=lerobot out=NEW
      drivezoo convert TUB out=NEW

    Args:
        source: folder of a recording, a LeRobot dataset or a tub.
        to: new format; null: udacity (driving_log.csv), for a folder of another format.
        out: new folder to write; null: SOURCE's name with the format, with a number if that exists.
        images: folder of a recording's images, if not IMG/.
        fps: LeRobot: frames per second to write; null: the recording's mean.
        crf: LeRobot: quality of the videos, of which 1 is the best and the largest.
        task: LeRobot: the task in words.
        steering: LeRobot: number that steers, as action:0; null: found by its name.
        camera: LeRobot: key of the camera that looks ahead; null: found by its name.
        speed_unit: LeRobot: unit of a speed whose name has none.
        fit: keep: images of other sizes as they are, which all commands stretch to 320 x 160; pad:
            with black bars, in their shape.
        on_bad_row: skip: leave out rows that cannot be read; each is counted.
        quality: quality of JPEGs written from videos or padded.

    Raises:
        InputError: the source cannot be read, or the new folder cannot be written.
        UsageError: the formats do not fit, or a value is wrong.
    """
    from rich.console import Console

    from datamodules.recording import ReadOptions, find_format, formats
    from zoo.base.new_folder import free_folder, refuse_existing
    from zoo.cli.console_progress import progress_bar

    place = Path(source).expanduser()
    found, _ = find_format(place)
    titles = {name: known.title for name, known in formats()}
    to = to or "udacity"
    if to == found:
        raise UsageError(
            f"to={to}: {source} is a {titles[to]} already; name another format: to=udacity, "
            "to=lerobot or to=donkeycar"
        )
    if "udacity" not in (to, found):
        raise UsageError(
            f"to={to}: a {titles[found]} becomes a recording first: leave out to=, then convert "
            "the new folder"
        )
    # Without SOURCE's own name, `.` has none to add the format to.
    whole = (place.parent if place.is_file() else place).absolute()
    out = out or free_folder(whole.with_name(f"{whole.name}_{to}"))
    refuse_existing(out.expanduser())
    with progress_bar("converting", Console(stderr=True)) as report:
        if to == "udacity":
            from datamodules.formats.recording_writer import convert_to_recording

            read = ReadOptions(images, "fail", on_bad_row, steering, camera, speed_unit)
            result = convert_to_recording(
                place, out, read, fit=fit, quality=quality, progress=report
            )
            words, purpose = ["drivezoo", "check", str(result.folder)], ""
        else:
            from datamodules.findings import skipped_lines
            from datamodules.recording import read_recordings

            recording = read_recordings(
                str(place), images, on_bad_image="skip", on_bad_row=on_bad_row
            )
            if to == "donkeycar":
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
    drives = f"{result.drives:,} continuous drive{'' if result.drives == 1 else 's'}"
    print(f"{titles[found]} -> {titles[to]}: {result.rows:,} rows, {drives}")
    for note in result.notes:
        print(printable(f"- {note}"))
    print_written([result.folder])
    print_next(command_line(words), purpose)
    return result.folder


if __name__ == "__main__":
    convert.run()
