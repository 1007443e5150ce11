"""`drivezoo edit`: look at a recording and clean it on a page."""

import contextlib
import errno
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from zoo.base.command import command
from zoo.base.errors import InputError
from zoo.base.terminal import command_line, printable
from zoo.cli.closing_lines import print_next, print_written

if TYPE_CHECKING:
    from datamodules.edited_recording import WrittenRecording
    from zoo.drive.notices import Notices
    from zoo.edit.edit_page import PageServer
    from zoo.edit.edit_session import EditSession


@dataclass(frozen=True, kw_only=True)
class EditOptions:
    """Keys of `drivezoo edit`.

    Args:
        ckpt: checkpoint whose steering is drawn next to the recorded one.
        images: folder of the images, if not IMG/.
        drop: rows to leave out, from 1: 120-180,2600-.
        keep: rows to keep; all others are dropped.
        mirror: rows to mirror from left to right.
        split: rows with which a further part begins: 1200,2000.
        out: new folder to write; null: FOLDER_edited, with a number if that exists.
        page: false: write at once, without a page.
        port: TCP port of the page on this machine; 0: a free one.
    """

    ckpt: str | None = None
    images: str | None = None
    drop: str | None = None
    keep: str | None = None
    mirror: str | None = None
    split: str | None = None
    out: Path | None = None
    page: bool = True
    port: Annotated[int, Field(ge=0, le=65535)] = 4570


@command
def edit(folder: str, *folders: str, options: EditOptions) -> None:
    """Look at a recording and clean it on a page.

    Drop bad stretches, trim, split, merge and mirror, with undo, and write the result as a new
    recording. The recorded folder stays as it is. Several folders become one recording.

      drivezoo edit FOLDER
      drivezoo edit FOLDER drop=120-180,2600- out=cleaned page=false

    Args:
        folder: recording's folder; several become one recording.
        *folders: further folders.
        options: see `EditOptions`.

    Raises:
        InputError: a recording, checkpoint, edit or output folder is wrong.
    """
    all_folders = [folder, *folders]
    from rich.console import Console

    from datamodules.findings import report_lines
    from datamodules.recording import read_recordings
    from datamodules.recording_edits import typed_edits
    from zoo.base.new_folder import refuse_existing
    from zoo.cli.console_progress import progress_bar
    from zoo.edit.edit_session import EditSession

    if options.out:
        refuse_existing(options.out.expanduser())
    recording = read_recordings(all_folders, options.images, on_bad_image="skip")
    texts = options.drop, options.keep, options.mirror, options.split
    edits = typed_edits(len(recording), *(text or "" for text in texts))
    for line in report_lines(recording):
        print(printable(line))
    session = EditSession(recording, edits, options.out, print_result)
    if not options.page:
        with progress_bar("writing", Console(stderr=True)) as report:
            session.write(report)
        return
    serve_page(session, options)
    if session.unsaved:
        print("the edits are not written; to resume with them:")
        print_next(command_line(resume_words(all_folders, options, session)))


def serve_page(session: "EditSession", options: EditOptions) -> None:
    """Serve the page until Ctrl-C, then wait until a recording that is being written is whole."""
    from zoo.drive.notices import Notices
    from zoo.edit.edit_page import EditPage
    from zoo.edit.frame_analysis import FrameAnalysis, load_predictor

    path, policy = load_predictor(options.ckpt) if options.ckpt else ("", None)
    analysis = FrameAnalysis(session.recording, policy)
    with open_server(options.port, Notices()) as server:
        server.show(EditPage(session, analysis, str(path)))
        url = f"http://{server.server_name}:{server.server_port}"
        with contextlib.suppress(KeyboardInterrupt):
            print(f"open {url} in a browser to look at the recording and edit it; Ctrl-C ends it")
            sys.stdout.flush()
            analysis.start()
            server.serve_forever()
        analysis.stop()
        session.finish()


def open_server(port: int, notices: "Notices") -> "PageServer":
    """Return a listening server.

    Raises:
        InputError: the port is in use; names the process that holds it.
    """
    from zoo.drive.port_holder import port_holder
    from zoo.edit.edit_page import PageServer

    try:
        return PageServer(port, notices)
    except OSError as error:
        holder = port_holder(port) if error.errno == errno.EADDRINUSE else None
        reason = f"held by {holder}" if holder else error.strerror
        raise InputError(f"port={port}: {reason}; add port=0 for a free one") from None


def print_result(written: "WrittenRecording") -> None:
    """Print the written folders, and how many rows were left out because of a bad image."""
    if written.left_out:
        first = f"{len(written.left_out)} (the first: {written.left_out[0]})"
        print(printable(f"rows left out because of a bad image: {first}"))
    folders = [str(folder) for folder in written.folders]
    print_written(folders, ["check", *folders])
    sys.stdout.flush()


def resume_words(folders: list[str], options: EditOptions, session: "EditSession") -> Iterator[str]:
    """Yield the words of a command that begins with the edits of now."""
    yield from ("drivezoo", "edit", *folders, *session.options())
    for key in ("ckpt", "images") if session.written else ("ckpt", "images", "out"):
        if value := getattr(options, key):
            yield f"{key}={value}"


if __name__ == "__main__":
    edit.run()
