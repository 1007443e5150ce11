"""`python -m datamodules.check FOLDER [FOLDER...]`: are a recording's rows and images whole?

Reads each image's header and end, not its pixels, so that thousands take seconds.
"""

import argparse
import os
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import PIL.Image
from rich.console import Console
from rich.progress import Progress

from datamodules.errors import InputError
from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH, TAIL, ends_early
from datamodules.recording import Recording, read_recordings
from datamodules.recording_report import report_lines

SHOWN = 20  # bad images that are listed, before a count


def check(roots: list[str], images: str | None, console: Console) -> bool:
    """Print what the recordings hold and what is wrong with their images; True if nothing is.

    Raises:
        InputError: a folder, a log or a row cannot be read, or there is no image at all.
    """
    recording = read_recordings(roots, images, on_bad_image="skip")
    for line in report_lines(replace(recording, bad_images=())):
        console.print(line, highlight=False, markup=False)
    sizes: Counter[tuple[int, int]] = Counter()
    bad = list(recording.bad_images)
    for row, path, found in _look_at_images(recording, console):
        if isinstance(found, str):
            bad.append(f"{recording.place(row)}: {path}: {found}")
        else:
            sizes[found] += 1
    for (width, height), count in sizes.most_common():
        usual = (width, height) == (FRAME_WIDTH, FRAME_HEIGHT)
        note = "" if usual else f" (will be resized to {FRAME_WIDTH} x {FRAME_HEIGHT})"
        console.print(f"{count:,} images of {width} x {height}{note}", highlight=False)
    for line in bad[:SHOWN]:
        console.print(line, highlight=False, markup=False)
    if len(bad) > SHOWN:
        console.print(f"and {len(bad) - SHOWN:,} more", highlight=False)
    verdict = f"{len(bad):,} bad; record or copy again, or train with data.on_bad_image=skip"
    console.print(verdict if bad else "all images are whole", highlight=False)
    return not bad


def look_at_image(path: str) -> tuple[int, int] | str:
    """`(width, height)` of a JPEG or PNG as its header says, or what is wrong with the file."""
    try:
        with open(path, "rb") as file:  # noqa: PTH123 - Path.open costs twice as much
            head = file.read(2)
            if not head:
                return "the file is empty"
            file.seek(max(os.fstat(file.fileno()).st_size - TAIL, 0))
            if ends_early(head, file.read()):
                return "the image is truncated"
            file.seek(0)
            with PIL.Image.open(file, formats=("JPEG", "PNG")) as image:
                return image.size
    except PIL.UnidentifiedImageError:
        return "the file is no JPEG or PNG"
    except (OSError, SyntaxError, ValueError) as error:  # PIL's, for a header that is damaged
        return getattr(error, "strerror", None) or str(error)


def _look_at_images(
    recording: Recording, console: Console
) -> Iterator[tuple[int, str, tuple[int, int] | str]]:
    """Row, path, and what `look_at_image` found, for every image, a thread per core."""
    images = [(row, path) for row, paths in enumerate(recording.images) for path in paths if path]
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        found = pool.map(look_at_image, [path for _, path in images])
        with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
            looked_at = progress.track(found, total=len(images), description="checking images")
            for (row, path), one in zip(images, looked_at, strict=True):
                yield row, path, one
    finally:
        pool.shutdown(cancel_futures=True)  # Ctrl-C need not wait for the rest


def main(arguments: list[str]) -> int:
    """Exit status 0 where all is whole, 1 where not."""
    parser = argparse.ArgumentParser(
        prog="python -m datamodules.check", description="Are a recording's rows and images whole?"
    )
    parser.add_argument("folders", nargs="+", metavar="FOLDER", help="it holds driving_log.csv")
    parser.add_argument("--images", metavar="FOLDER", help="the pictures, if not in IMG")
    options = parser.parse_args(arguments)
    try:
        return 0 if check(options.folders, options.images, Console(soft_wrap=True)) else 1
    except InputError as error:
        print(f"check: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("check: stopped", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
