"""`drivezoo edit`: look at a recording and clean it on a page."""

import contextlib
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from datamodules.format_options import ReadOptions
from zoo.base.command import command
from zoo.base.command_keys import typed
from zoo.base.terminal import command_line, print_next, print_written, printable

if TYPE_CHECKING:
    from datamodules.edited_recording import WrittenRecording
    from zoo.server.edit_session import EditSession


@command
def edit(
    folder: str,
    *folders: str,
    ckpt: str | None = None,
    drop: str | None = None,
    keep: str | None = None,
    mirror: str | None = None,
    split: str | None = None,
    out: Path | None = None,
    page: bool = True,
    port: Annotated[int, Field(ge=0, le=65535)] = 4570,
    read: ReadOptions,
) -> None:
    """Look at a recording and clean it on a page.

    Drop bad stretches, trim, split, merge and mirror, with undo, and write the result as a new
    recording. The recorded folder stays as it is. Several folders become one recording.

      drivezoo edit FOLDER
      drivezoo edit FOLDER drop=120-180,2600- out=cleaned page=false

    Args:
        folder: recording's folder; several become one recording.
        *folders: further folders.
        ckpt: checkpoint whose steering is drawn next to the recorded one.
        drop: rows to leave out, from 1: 120-180,2600-.
        keep: rows to keep; all others are dropped.
        mirror: rows to mirror from left to right.
        split: rows with which a further part begins: 1200,2000.
        out: new folder to write; null: FOLDER_edited, with a number if that exists.
        page: false: write at once, without a page.
        port: TCP port of the page on this machine; 0: a free one.
        read: see `ReadOptions`.

    Raises:
        InputError: a recording, checkpoint, edit or output folder is wrong.
    """
    all_folders = [folder, *folders]
    from rich.console import Console

    from datamodules.looking.findings import report_lines
    from datamodules.recording_edits import typed_edits
    from datamodules.recording_format import read_recordings
    from zoo.base.console_progress import progress_bar
    from zoo.base.new_folder import refuse_existing
    from zoo.server.edit_session import EditSession

    if out:
        refuse_existing(out.expanduser())
    recording = read_recordings(all_folders, **{**asdict(read), "on_bad_image": "skip"})
    edits = typed_edits(len(recording), drop, keep, mirror, split)
    for line in report_lines(recording):
        print(printable(line))
    firsts = [first for first, _ in (*edits.dropped, *edits.mirrored)]
    for row in sorted([*firsts, *edits.splits])[:1]:
        print(printable(f"the first edited row, {row + 1}, is {recording.place(row)}"))
    session = EditSession(recording, edits, out, print_result)
    if not page:
        with progress_bar("writing", Console(stderr=True)) as report:
            session.write(report)
        return
    serve_page(session, ckpt, port)
    if session.unsaved:
        options = {"ckpt": ckpt, "out": None if session.written else out, **read.given()}
        keys = [f"{key}={typed(value)}" for key, value in options.items() if value]
        print("the edits are not written; to resume with them:")
        print_next(command_line(["drivezoo", "edit", *all_folders, *session.options(), *keys]))


def serve_page(session: "EditSession", ckpt: str | None, port: int) -> None:
    """Serve the page until Ctrl-C, then wait until a recording that is being written is whole."""
    from zoo.base.console_progress import loading
    from zoo.base.page_server import PageServer
    from zoo.checkpoints.checkpoint_path import find_checkpoint
    from zoo.server.edit_page import EditPage
    from zoo.server.edit_session import FrameAnalysis

    path, policy = "", None
    if ckpt:
        path = str(find_checkpoint(ckpt))
        with loading():
            from zoo.checkpoints.checkpoint_policy import load_policy

            policy = load_policy(path)
    analysis = FrameAnalysis(session.recording, policy)
    with PageServer(port, EditPage(session, analysis, path)) as server:
        url = f"http://{server.server_name}:{server.server_port}"
        with contextlib.suppress(KeyboardInterrupt):
            print(f"open {url} in a browser to look at the recording and edit it; Ctrl-C ends it")
            sys.stdout.flush()
            analysis.start()
            server.serve_forever()
        analysis.stop()
        session.finish()


def print_result(written: "WrittenRecording") -> None:
    """Print the written folders, and how many rows were left out because of a bad image."""
    if written.left_out:
        first = f"{len(written.left_out)} (the first: {written.left_out[0]})"
        print(printable(f"rows left out because of a bad image: {first}"))
    print_written(written.folders, ["check", *written.folders])
    sys.stdout.flush()


if __name__ == "__main__":
    edit.run()
