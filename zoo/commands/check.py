"""`drivezoo check`: check recordings before training."""

import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from itertools import chain
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from datamodules.balance import epoch_batches
from datamodules.driving_log import CAMERAS
from datamodules.format_options import ReadOptions
from datamodules.image import AnyImage, checked_size, read_stored, reading_threads
from datamodules.looking.findings import find_oddities, report_lines
from datamodules.looking.leak import leak_lines
from datamodules.looking.sign_evidence import SignEvidence, find_sign_evidence, sign_line
from datamodules.recorded_car import other_car
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from datamodules.samples import make_samples
from datamodules.split import split_rows
from datamodules.steering_unit import EXAMPLE, SteeringUnit, keys_and_values
from zoo.base.command import command, is_help
from zoo.base.command_keys import typed
from zoo.base.errors import InputError
from zoo.base.key_values import read_texts
from zoo.base.run_command import exit_after
from zoo.base.terminal import command_line, counted, printable

FIRST_TRY = "experiment=first_try"  # docs/recipes.md, "A first try that drives"
AT_ONCE = 64  # images of a thread's task: each task takes 1 kB until the last is done
SHOWN = 20  # bad rows and images that are listed; the others are counted


@command
def check(folder: str, *folders: str, read: ReadOptions) -> bool:
    """Check recordings before training: rows, images, and what is unusual.

    Reads each image's header and end marker but decodes no pixels: thousands of images take
    seconds. Lists bad rows and images, and exits with 1 if there are any.

    Args:
        folder: folder of a recording; several are checked as one recording.
        *folders: further folders.
        read: see `ReadOptions`.

    Returns:
        Whether all images are whole, and all rows that are not to be skipped.

    Raises:
        InputError: a folder or a log cannot be read, or there is no good row or image.
    """
    roots, console = [folder, *folders], Console(soft_wrap=True)
    skipping = replace(read, on_bad_image="skip", on_bad_row="skip")
    recording = read_recordings(roots, **asdict(skipping))
    for line in report_lines(replace(recording, bad_images=(), bad_rows=())):
        _print(console, line)
    sizes: Counter[tuple[int, int]] = Counter()
    bad, is_whole = list(recording.bad_images), np.ones(len(recording), bool)
    rows, cameras = np.nonzero(recording.images)
    paths = recording.images[rows, cameras]
    pool = ThreadPoolExecutor(reading_threads(paths, os.cpu_count() or 1))
    try:
        some = [paths[start : start + AT_ONCE] for start in range(0, len(paths), AT_ONCE)]
        looks = chain.from_iterable(pool.map(lambda part: list(map(look_at_image, part)), some))
        with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
            looked_at = progress.track(looks, total=len(paths), description="checking images")
            for row, path, size in zip(rows.tolist(), paths, looked_at, strict=True):
                if isinstance(size, str):
                    bad.append(f"{recording.place(row)}: {path}: {size}")
                    is_whole[row] = False
                else:
                    sizes[size] += 1
    finally:
        pool.shutdown(cancel_futures=True)  # on Ctrl-C, do not wait for the other images
    whole = recording.keep(is_whole)
    is_each = bool(np.bincount(whole.recording, minlength=len(whole.names)).all())
    signs = list(map(find_sign_evidence, whole.recordings)) if is_each else []
    for line in [*map(sign_line, whole.names, signs), *leak_lines(whole)]:
        _print(console, line)
    if recording.bad_rows:
        _print(console, f"skipped {counted(len(recording.bad_rows), 'bad row')}:")
        _print_first(console, recording.bad_rows)
    for (width, height), count in sizes.most_common():
        _print(console, f"{counted(count, 'image')} of {width} x {height}")
    _print_first(console, bad)
    if not len(whole):
        _print(console, f"{counted(len(bad), 'bad image')}; no row is without one: copy them again")
        return False
    skip = "copy or record again, or train with data.on_bad_image=skip"
    _print(console, f"{counted(len(bad), 'bad image')}; {skip}" if bad else "all images are whole")
    if oddities := find_oddities(whole):
        _print(console, "before you train:")
    for oddity in oddities:
        _print(console, f"- {oddity.text}")
    keys = read.given() | ({"on_bad_image": "skip"} if bad else {})
    keys |= {"on_bad_row": "skip"} if recording.bad_rows else {}
    # A network of another car is judged by its held-out drives, which single rows are not.
    split = ["data.split=blocks"] if other_car(recording) else []
    # A network would learn to steer to the other side.
    if turned := _turned(read, whole, signs):
        words = [f"{key}={typed(value)}" for key, value in (keys | turned).items()]
        _print(console, f"next: {command_line(['drivezoo', 'check', *roots, *words])}")
    elif any(EXAMPLE in line for line in recording.bad_rows):
        _print(console, "no training yet: what do the steering's numbers mean? name data.steering")
    else:
        try:
            keys |= _needed_keys(whole)
        except InputError as error:
            _print(console, f"no training yet: {error}")
        else:
            for line in _next_commands(roots, keys, split):
                _print(console, line)
    return not bad and (not recording.bad_rows or read.on_bad_row == "skip")


def _print(console: Console, line: str) -> None:
    console.out(printable(line), highlight=False)


def _print_first(console: Console, lines: Sequence[str]) -> None:
    for line in lines[:SHOWN]:
        _print(console, line)
    if len(lines) > SHOWN:
        _print(console, f"and {len(lines) - SHOWN:,} more")


def _next_commands(roots: list[str], given: dict[str, Any], split: list[str]) -> Iterator[str]:
    """Yield a line for each next command, quoted for a shell and for Hydra."""
    quoted = [text.replace("\\", "\\\\").replace("'", "\\'") for text in roots]
    joined = ",".join(f"'{text}'" for text in quoted)  # a list in Hydra's grammar
    keys = [f"data.root={roots[0] if len(roots) == 1 else f'[{joined}]'}"]
    keys += [f"data.{key}={typed(value)}" for key, value in given.items()]
    yield f"show the network's input: {command_line(['drivezoo', 'preview', *keys])}"
    yield f"next: {command_line(['drivezoo', 'train', FIRST_TRY, *split, *keys])}"


def _needed_keys(recording: Recording) -> dict[str, Any]:
    """Return the keys that a training on these rows needs to start.

    Raises:
        InputError: no key lets it start; see `split_rows`.
    """
    # Side cameras show bends.
    samples = make_samples(recording, split_rows(recording).train, [*CAMERAS], offset=1.0)
    try:
        epoch_batches(samples, len(samples), epoch=0, seed=0)
    except InputError:
        return {"straight_cap": None}
    return {}


def _turned(read: ReadOptions, recording: Recording, signs: list[SignEvidence]) -> dict[str, Any]:
    """Return the key that turns the sign of the recordings with left and right exchanged."""
    said = (keys_and_values("each", read.each) or {}).items()
    each = {int(number): dict(keys) for number, keys in said}
    wrong = [number for number, sign in enumerate(signs) if sign.is_exchanged]
    for number in wrong:
        unit = recording.units[number] or read.of_each(len(signs))[number].unit or SteeringUnit()
        other = replace(unit, right="positive" if unit.right == "negative" else "negative")
        each.setdefault(number + 1, {})["steering"] = asdict(other)
    if not read.each and len(wrong) == len(signs) and len(set(recording.units)) == 1:
        return each.get(1, {})
    return {"each": each} if wrong else {}


def look_at_image(image: AnyImage) -> tuple[int, int] | str:
    """Return a JPEG's or PNG's `(width, height)` by its header, or what is wrong with the file."""
    try:
        stored = read_stored(image)
        if isinstance(stored, bytes):
            return checked_size(stored)
        return stored.shape[1], stored.shape[0]
    except (OSError, ValueError) as error:
        return getattr(error, "strerror", None) or str(error)


def main(arguments: list[str]) -> None:
    """Check recordings; exit with 1 if an image or a row is bad."""
    given = [argument.removeprefix("data.root=") for argument in arguments]
    if is_help(given):
        check.main(given)
        return
    paths, options = check.split(given)
    if not check(*paths, **read_texts(options, "data")):  # also with a training's keys
        sys.exit(1)


if __name__ == "__main__":
    exit_after("drivezoo check", main)
