"""`drivezoo convert`: exchange recordings with LeRobot, Donkeycar and others."""

from dataclasses import asdict, replace
from pathlib import Path

from datamodules.format_options import ReadOptions, WriteOptions
from zoo.base.command import command
from zoo.base.errors import UsageError, hint
from zoo.base.terminal import (
    command_line,
    counted,
    print_next,
    print_written,
    printable,
    shown_path,
)

LOG = "udacity"  # format that most programs of the course read


@command
def convert(
    source: str,
    *sources: str,
    to: str | None = None,
    out: Path | None = None,
    write: WriteOptions,
    read: ReadOptions,
) -> Path:
    """Write a recording as Udacity's log, a LeRobot dataset, a Donkeycar tub, or shards.

    Finds out by its files what SOURCE is. Several become one dataset, tub, or folder of shards.

      drivezoo convert FOLDER to=lerobot out=NEW
      drivezoo convert TUB out=NEW
      drivezoo convert FOLDER to=lerobot "size=[96,96]" keep=1-900

    Args:
        source: folder or file of a recording, or address of shards.
        *sources: further ones.
        to: new format: lerobot, donkeycar, shards, or one of yours that has `write`; null: udacity
            (driving_log.csv), for a folder of another format.
        out: new folder to write; null: SOURCE's name with the format, with a number if that exists.
        write: see `WriteOptions`.
        read: see `ReadOptions`.

    Raises:
        InputError: the source cannot be read, or the new folder cannot be written.
        UsageError: the formats do not fit, or a value is wrong.
    """
    from rich.console import Console

    from datamodules.formats.recording_writer import chosen_recording
    from datamodules.known_formats import writable_formats
    from datamodules.looking.findings import skipped_lines
    from datamodules.recording_format import find_format, read_recordings
    from zoo.base.console_progress import progress_bar
    from zoo.base.new_folder import free_folder, refuse_existing

    writers, path, to = writable_formats(), Path(source).expanduser(), to or LOG
    if to not in writers:
        raise UsageError(f"to={to}: no format that can be written; {hint(to, writers)}")
    name, old = find_format(path, read.format)
    if to == name and not sources:
        others = ", ".join(f"to={writer}" for writer in writers if writer != name)
        raise UsageError(f"to={to}: {source} is a {old.title} already; name another: {others}")
    taken = getattr(writers[to], "keys", ())
    for key in sorted({key for writer in writers.values() for key in getattr(writer, "keys", ())}):
        if key not in taken and getattr(write, key) != getattr(WriteOptions, key):
            raise UsageError(f"{key}={getattr(write, key)}: to={to} does not use it; leave it out")
    if to == LOG and sources:
        raise UsageError(f"to={to}: takes one recording; convert each, and name all in data.root")
    # Without SOURCE's own name, `.` has none to add the format to.
    whole = (path.parent if path.is_file() else path).absolute()
    out = out or free_folder(whole.with_name(f"{whole.name}_{to}"))
    refuse_existing(out.expanduser())
    read = replace(read, on_bad_image="skip")
    with progress_bar("converting", Console(stderr=True)) as report:
        recording = read_recordings([source, *sources], **asdict(read))
        # The writer of a log notes itself what reading left out.
        skipped = [] if to == LOG else [*recording.notes, *skipped_lines(recording)]
        recording, chosen = chosen_recording(recording, write)
        result = writers[to].write(recording, out, write, report)
    drives = counted(result.drives, "continuous drive")
    print(f"{old.title} -> {writers[to].title}: {counted(result.rows, 'row')}, {drives}")
    for note in (*skipped, *chosen, *result.notes):
        print(printable(f"- {note}"))
    print_written([result.folder])
    following = result.following or ("drivezoo", "check", shown_path(result.folder))
    print_next(command_line(following), result.purpose)
    return result.folder


if __name__ == "__main__":
    convert.run()
