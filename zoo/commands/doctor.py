"""`drivezoo doctor`: find faults of this machine."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from zoo.base.command import command, is_help
from zoo.base.errors import UsageError
from zoo.base.key_values import check_keys, read_texts
from zoo.base.run_command import exit_after
from zoo.base.terminal import command_line, print_next, printable
from zoo.checkpoints.checkpoint_path import FOLDER, LATEST, find_checkpoint, packaged_file
from zoo.server import input_checks as inputs
from zoo.server import machine_checks as machine
from zoo.server import renderer_check as renderer
from zoo.server.machine_checks import FAULT, OK, WARNING, Finding, careful

PORT = 4567
COLOURS = {OK: "32", WARNING: "33", FAULT: "31"}
NAME_WIDTH, STATE_WIDTH = 12, 9


@command
def doctor(ckpt: str | None = None, recording: str | None = None, *, port: int = PORT) -> None:
    """Find faults of this machine.

    Checks packages, device, renderer, port and disk, and prints each fault with its fix. With a
    checkpoint, also drives a round trip with the original simulator's protocol. Exits 0 without
    faults, even with warnings; 1 otherwise.

    Args:
        ckpt: checkpoint: a .ckpt or .onnx file, a run's folder, latest, or a network that comes
            with drivezoo, such as lenet; checks that it loads and drives.
        recording: folder of a recording; checks its log and a sample of its images.
        port: TCP port to try, 1..65535.
    """
    counts = {OK: 0, WARNING: 0, FAULT: 0}
    for finding in diagnose(ckpt, recording, port):
        counts[finding.state] += 1
        print_finding(finding)
    print(f"faults: {counts[FAULT]}, warnings: {counts[WARNING]}, ok: {counts[OK]}")
    if counts[FAULT]:
        sys.exit(1)
    data = None
    if ckpt is not None:
        from zoo.checkpoints.checkpoint_policy import load_policy

        data = load_policy(ckpt).data
    print_next(*next_step(ckpt, recording, data))


def diagnose(checkpoint: str | None, recording: str | None, port: int) -> Iterator[Finding]:
    """Yield each finding as soon as it is found; raise nothing."""
    yield from careful("Python", machine.check_python)
    if sys.version_info < machine.OLDEST:
        return  # every other check would fail for this reason
    renderers = renderer.start_renderers()  # runs while torch is imported
    yield from careful("packages", machine.check_packages)
    yield from careful("device", machine.check_device)
    yield from careful("renderer", renderers)
    yield from careful("port", partial(machine.check_port, port))
    yield from careful("disk", machine.check_disk)
    yield from careful("cache", machine.check_cache)
    if recording is not None:
        check = partial(inputs.check_recording, recording)
        yield from careful("recording", check, "record or copy it again")
    if checkpoint is None:
        return
    usable = True
    check = partial(inputs.check_checkpoint, checkpoint, recording)
    fix = "name a checkpoint that drivezoo train wrote, or train again"
    for finding in careful("checkpoint", check, fix):
        usable = usable and finding.state != FAULT
        yield finding
    if usable:
        yield from careful("round trip", partial(inputs.check_round_trip, checkpoint))


def sort_paths(paths: list[str]) -> tuple[str | None, str | None]:
    """Return checkpoint and recording from paths in any order.

    Raises:
        UsageError: two are of a kind.
        InputError: a run's folder has no checkpoint.
    """
    chosen: dict[str, str] = {}
    for named in paths:
        path = Path(named).expanduser()
        is_run = path.is_dir() and (path.name == FOLDER or (path / FOLDER).is_dir())
        is_name = not path.exists() and (named == LATEST or packaged_file(named) is not None)
        is_recording = path.is_dir() or path.suffix in ("", ".csv")
        kind = "CKPT" if is_run or is_name or not is_recording else "RECORDING"
        if kind in chosen:
            raise UsageError(
                f"{named}: {kind} is given twice, also {chosen[kind]}; usage: {doctor.usage}"
            )
        chosen[kind] = str(find_checkpoint(named)) if is_run or is_name else named
    return chosen.get("CKPT"), chosen.get("RECORDING")


def print_finding(finding: Finding) -> None:
    """Print state, subject and text of a finding in a row, and its fix below."""
    indent = " " * (STATE_WIDTH + NAME_WIDTH)
    width = max(shutil.get_terminal_size((100, 24)).columns, 60)
    state = f"{finding.state:<{STATE_WIDTH}}"
    if sys.stdout and sys.stdout.isatty() and "NO_COLOR" not in os.environ:
        state = f"\033[{COLOURS[finding.state]}m{state}\033[0m"
    texts = [finding.found] + ([f"fix: {finding.fix}"] if finding.fix else [])
    # A long path or command is not broken, so that users can copy it.
    wrap = textwrap.TextWrapper(
        width - len(indent), break_long_words=False, break_on_hyphens=False
    ).wrap
    first, *rest = [line for text in texts for line in wrap(text)] or [""]
    print(f"{state}{finding.what:<{NAME_WIDTH}}{printable(first)}", flush=True)
    for line in rest:
        print(indent + printable(line), flush=True)


def main(arguments: list[str]) -> None:
    """Run the command, whose arguments stand in any order."""
    if is_help(arguments):
        print(doctor.help())
        return
    paths, options = doctor.split(arguments)
    texts = read_texts(options, "doctor")
    check_keys(texts, doctor.keys)
    port = texts.get("port", str(PORT))
    if not (port.isdecimal() and 0 < int(port) < 65536):  # without pydantic, which may be missing
        raise UsageError(f"port={port}: must be a whole number in 1..65535")
    doctor.function(*sort_paths(paths), port=int(port))


def next_step(
    checkpoint: str | None, recording: str | None, data: object = None
) -> tuple[str, str]:
    """Return the command after a check without faults, and its purpose.

    `data` has the facts on the checkpoint's recording.
    """
    if checkpoint is not None:
        from zoo.scoring.evidence import next_drive

        words = next_drive(checkpoint, data, ["evaluate", checkpoint])
        return command_line(["drivezoo", *map(str, words)]), "let it drive"
    if recording is not None:
        return command_line(["drivezoo", "check", recording]), "what it teaches badly"
    return "drivezoo demo", "record, train and drive a demo"


if __name__ == "__main__":
    exit_after("drivezoo doctor", main)
