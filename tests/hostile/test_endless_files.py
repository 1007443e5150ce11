"""Files without an end, or far too large, in place of those that are read."""

import os
import socket
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.driving_log import MOST_LOG_BYTES
from datamodules.image import (
    MOST_IMAGE_BYTES,
    MOST_PIXELS,
    MOST_SCANS,
    decode_image,
    find_size_fault,
    read_image,
)
from datamodules.recording_format import read_recordings
from datamodules.split import split_rows
from datamodules.view import View
from datamodules.view_store import load_views
from tests.recordings import Written, recording_in_memory, write_recording
from tests.refusals import refusal
from tests.slow_members import slow
from tests.zoo.command_runs import only_line, run, run_here
from tests.zoo.server.scans import SCANS, many_scans, png_claim
from tests.zoo.trainings import SMALL
from zoo.base.bounded_files import open_regular, read_regular
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_plain
from zoo.checkpoints.onnx_policy import open_session
from zoo.commands.check import look_at_image
from zoo.scoring.blocks import Image
from zoo.simulator.track_file import read_track

Make = Callable[[Path], object]


def listening(path: Path) -> None:
    """Create a socket's file; closing the socket keeps the file."""
    cwd = Path.cwd()
    os.chdir(path.parent)  # the path of a socket must be short
    try:
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(path.name)
    finally:
        os.chdir(cwd)


def sparse(size: int) -> Make:
    return lambda path: path.open("wb").truncate(size)


ENDLESS: dict[str, tuple[Make, str]] = {
    "pipe": (os.mkfifo, "no regular file"),
    "device": (lambda path: path.symlink_to("/dev/zero"), "no regular file"),
    "socket": (listening, "No such device"),
    "folder": (Path.mkdir, "directory"),
}
KERNEL = Path("/proc/kmsg")  # claims to be a regular file of 0 bytes, but reading it blocks


OPENED: dict[str, Callable[[Path], object]] = {
    "file": lambda path: open_regular(path, 1000),
    "plot of a report": lambda path: Image.read(path, "a plot"),
}


@pytest.mark.parametrize("kind", OPENED)
@pytest.mark.parametrize("name", ENDLESS)
def test_only_a_regular_file_is_opened(kind: str, name: str, tmp_path: Path) -> None:
    make, words = ENDLESS[name]
    make(tmp_path / "file.png")
    with pytest.raises(OSError, match=words) as caught:
        OPENED[kind](tmp_path / "file.png")
    assert caught.value.filename == str(tmp_path / "file.png")


def test_a_link_to_a_regular_file_is_one(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"abc")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    assert read_regular(tmp_path / "link", 3) == b"abc"
    with pytest.raises(OSError, match=r"3.* 2\b"):
        read_regular(tmp_path / "link", 2)


def test_no_descriptor_is_left_open(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    before = len([*Path("/proc/self/fd").iterdir()])
    for _ in range(5):
        with pytest.raises(OSError, match="no regular file"):
            open_regular(tmp_path / "pipe", 1000)
    assert len([*Path("/proc/self/fd").iterdir()]) == before


READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "checkpoint": ("x.ckpt", load_plain),
    "ONNX": ("x.onnx", lambda path: open_session(path, 1)),
    "track": ("x.yaml", lambda path: read_track(str(path))),
    "log": ("driving_log.csv", lambda path: read_recordings(str(path.parent))),
    "split": ("split.csv", lambda path: split_rows(recording_in_memory(np.zeros(9)), str(path))),
}


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("name", [*ENDLESS, "kernel"])
def test_only_regular_files_are_read(kind: str, name: str, tmp_path: Path) -> None:
    file, read = READERS[kind]
    make, _ = ENDLESS.get(name, (lambda path: path.symlink_to(KERNEL), ""))
    make(tmp_path / file)
    assert str(tmp_path) in refusal(read, tmp_path / file)


def test_a_log_beyond_its_limit_is_refused_unread(tmp_path: Path) -> None:
    sparse(MOST_LOG_BYTES + 1)(tmp_path / "driving_log.csv")
    with pytest.raises(InputError, match=r"driving_log\.csv: .*500,000,001"):
        read_recordings(str(tmp_path))


def jpeg_header(width: int, height: int) -> bytes:
    """Return a JPEG whose header claims a size."""
    _, data = cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))
    whole = bytearray(data.tobytes())
    struct.pack_into(">HH", whole, whole.index(b"\xff\xc0") + 5, height, width)
    return bytes(whole)


LARGE = {
    "PNG": png_claim(20_000, 20_000),
    "JPEG": jpeg_header(20_000, 20_000),
    "PNG beyond Pillow's": png_claim(60_000, 60_000),
}


def repeated_scan(components: int) -> bytes:
    """Return a sequential JPEG of three components whose scan, of some of them, is repeated."""
    plain = bytearray(cv2.imencode(".jpg", np.full((160, 320, 3), 90, np.uint8))[1].tobytes())
    scan = plain.rindex(b"\xff\xda")
    plain[scan + 4] = components
    return bytes(plain[:-2] + plain[scan:-2] * MOST_SCANS + plain[-2:])


EXPENSIVE = {name: (image, f"{MOST_PIXELS:,}") for name, image in LARGE.items()} | {
    "10,796 scans": (many_scans(10_796), rf"10,796 scans.*{MOST_SCANS}"),
    "one scan too many": (many_scans(MOST_SCANS + 1), rf"{MOST_SCANS + 1} scans.*{MOST_SCANS}"),
    "scans of a sequential image": (repeated_scan(1), f"{MOST_SCANS + 1} scans"),
}


@pytest.mark.parametrize("name", EXPENSIVE)
def test_check_and_training_refuse_an_expensive_image_undecoded(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, recwarn: pytest.WarningsRecorder
) -> None:
    monkeypatch.setattr("cv2.imdecode", None)
    path = tmp_path / "image.jpg"
    image, words = EXPENSIVE[name]
    path.write_bytes(image)
    with pytest.raises(ValueError, match=words) as caught:
        read_image(path)
    assert look_at_image(str(path)) == str(caught.value)
    # Python may report a file here that another test left open.
    assert {warning.category for warning in recwarn} <= {ResourceWarning}


@pytest.mark.parametrize("scans", [SCANS, MOST_SCANS])
def test_a_progressive_image_within_the_limit_is_decoded(scans: int, tmp_path: Path) -> None:
    path = tmp_path / "image.jpg"
    path.write_bytes(many_scans(scans))
    assert look_at_image(str(path)) == (320, 320)
    assert read_image(path).shape == (320, 320, 3)


@pytest.mark.parametrize("module", ["zoo.commands.check", *slow("zoo")])
def test_a_scan_bomb_is_named_with_its_row(module: str, replaced: Written, tmp_path: Path) -> None:
    image = replaced.image(7)
    image.write_bytes(many_scans(10_796))
    if module == "zoo":
        places = (f"data.root={replaced.folder}", "data.cache=null", "hydra.run.dir=run")
        line = only_line(run(tmp_path, *SMALL, *places, timeout=100))
    else:
        result = run_here(tmp_path, str(replaced.folder), module=module)
        assert result.returncode == 1
        (line,) = [text for text in result.stdout.splitlines() if "scans" in text]
    for text in (f"{replaced.log}, row 8: ", image.name, "10,796 scans"):
        assert text in line


def test_an_image_at_the_limit_is_decoded() -> None:
    assert decode_image(jpeg_header(8, 8)).shape == (8, 8, 3)
    assert find_size_fault(8_000, MOST_PIXELS // 8_000) is None
    assert find_size_fault(8_000, MOST_PIXELS // 8_000 + 1)


@pytest.mark.parametrize("name", [*ENDLESS, "kernel", "large"])
def test_check_and_training_name_an_endless_image(name: str, tmp_path: Path) -> None:
    more = {
        "kernel": (lambda path: path.symlink_to(KERNEL), "empty"),
        "large": (sparse(MOST_IMAGE_BYTES + 1), "32,000,001"),
    }
    make, words = (ENDLESS | more)[name]
    path = tmp_path / "image.jpg"
    make(path)
    assert words in str(look_at_image(str(path)))
    with pytest.raises((OSError, ValueError), match=words):
        read_image(path)


@pytest.fixture
def replaced(tmp_path: Path) -> Written:
    """Write a recording; tests replace one of its images with another kind of file."""
    return write_recording(tmp_path / "lake", rows=40)


def test_decoding_names_the_file(replaced: Written) -> None:
    image = replaced.image(7)
    image.write_bytes(LARGE["JPEG"])
    paths = [str(replaced.image(row)) for row in range(10)]
    faults = load_views(paths, View([60, 40], "gray", [8, 8]), None).faults
    assert list(faults) == [7]
    assert str(image) in faults[7]
    assert "20000 x 20000" in faults[7]


def test_film_names_an_image_that_is_no_regular_file(replaced: Written, tmp_path: Path) -> None:
    images = tmp_path / "images"
    images.mkdir()
    os.mkfifo(images / "a.jpg")
    line = only_line(run_here(tmp_path, str(images), module="zoo.commands.film"))
    assert f"{images / 'a.jpg'}: " in line
    assert "no regular file" in line
