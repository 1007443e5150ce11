"""The contract `Recording`: every format, and one of a package outside of the checkout."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from datamodules.formats.donkeycar import export_tub
from datamodules.formats.lerobot_export import export_lerobot
from datamodules.formats.recording_writer import convert_to_recording
from datamodules.read_options import ReadOptions
from datamodules.recording import Recording
from datamodules.recording_format import find_format, formats, read_recordings
from tests.recordings import write_recording
from zoo.base.errors import InputError
from zoo.base.rig import UDACITY

ROWS = 30
OUTSIDE = Path("docs/extending.md")


def outside_code() -> str:
    """Return the outside format of the manual."""
    text = (Path(__file__).parents[2] / OUTSIDE).read_text(encoding="utf-8")
    return text.partition("# my_formats.py\n")[2].partition("```")[0]


@pytest.fixture
def outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install a package with a format: code and metadata in a folder on `sys.path`."""
    site = tmp_path / "site"
    info = site / "my_formats-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "my_formats.py").write_text(outside_code())
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my_formats\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[drivezoo.formats]\nnamed = my_formats\n")
    monkeypatch.syspath_prepend(str(site))


def named_images(source: Recording, out: Path) -> None:
    out.mkdir()
    for row, path in enumerate(source.images[:, 0]):
        shutil.copy(path, out / f"{row:05d}_{float(source.steering[row])!r}.jpg")


def udacity(source: Recording, out: Path) -> None:
    shutil.copytree(source.names[0], out)


WRITERS: dict[str, Callable[[Recording, Path], object]] = {
    "udacity": udacity,
    "lerobot": export_lerobot,
    "donkeycar": export_tub,
    "named": named_images,
}


@pytest.fixture
def source(tmp_path: Path) -> Recording:
    return read_recordings(str(write_recording(tmp_path / "source", ROWS).folder))


@pytest.mark.usefixtures("outside")
@pytest.mark.parametrize("name", WRITERS)
def test_a_format_is_detected_and_read_and_becomes_a_log(
    name: str, source: Recording, tmp_path: Path
) -> None:
    if name == "lerobot":
        pytest.importorskip("pyarrow")
    WRITERS[name](source, tmp_path / name)
    assert [one for one, known in formats() if known.detect(tmp_path / name)] == [name]
    detected, known = find_format(tmp_path / name)
    assert (detected, bool(known.title)) == (name, True)
    recording = known.read(tmp_path / name, ReadOptions())
    check_recording(recording, source)
    convert_to_recording(tmp_path / name, tmp_path / "log")
    check_recording(read_recordings(str(tmp_path / "log")), source)


def check_recording(recording: Recording, source: Recording) -> None:
    """Check all that the contract promises, against the recording that was written."""
    assert len(recording) == ROWS
    np.testing.assert_array_equal(recording.steering, source.steering)
    for column, low in ((recording.throttle, -1), (recording.brake, 0), (recording.speed_mph, 0)):
        assert column.dtype == float
        assert ((column >= low) & np.isfinite(column)).all()
    assert recording.time_s.shape == (ROWS,)
    assert recording.images.shape == (ROWS, 3)
    for row in (3, 0, ROWS - 1):  # also backwards
        image = recording.image(row)
        assert (image.shape, image.dtype) == ((160, 320, 3), np.uint8)
        assert np.abs(image.astype(float) - source.image(row)).mean() < 3
    assert str(row + 1) in recording.place(row) or "jpg" in recording.place(row)
    assert recording.rig in (UDACITY, None)
    part = recording.keep(np.arange(ROWS) > 20)
    assert part.place(0) == recording.place(21)
    assert (part.image(0) == recording.image(21)).all()


@pytest.mark.usefixtures("outside")
def test_damage_is_one_line_with_the_place_and_the_remedy(
    source: Recording, tmp_path: Path
) -> None:
    named_images(source, tmp_path / "named")
    (tmp_path / "named/00003_7.5.jpg").write_bytes(b"")
    with pytest.raises(InputError, match=r"00003_7\.5\.jpg: steering is 7\.5.*on_bad_row=skip"):
        convert_to_recording(tmp_path / "named", tmp_path / "log")


def test_a_format_that_cannot_be_imported_is_named(
    outside: None, source: Recording, tmp_path: Path
) -> None:
    (tmp_path / "site/my_formats-1.0.dist-info/entry_points.txt").write_text(
        "[drivezoo.formats]\nlost = no_such_module\n"
    )
    assert find_format(Path(source.names[0]))[0] == "udacity", "found before it is imported"
    with pytest.raises(InputError, match="no_such_module: the format lost"):
        find_format(tmp_path)
