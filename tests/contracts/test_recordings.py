"""The contract `Recording`: every format, and one of a package outside of the checkout."""

import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from datamodules.edited_recording import write_edited
from datamodules.format_options import ReadOptions
from datamodules.known_formats import OWN, formats, writable_formats
from datamodules.recorded_car import other_car
from datamodules.recording import TIMED_LABELS, Recording
from datamodules.recording_edits import Edits
from datamodules.recording_format import find_format, read_recordings
from tests import foreign_recordings as foreign
from tests.contracts.outside_package import installed, manual_example
from tests.recordings import convert_to_recording, replace_in, write_as, write_recording
from zoo.base.errors import InputError, UsageError
from zoo.base.rig import UDACITY

ROWS = 30


@pytest.fixture
def outside(tmp_path: Path) -> Iterator[None]:
    """Install a package with a format."""
    with installed(tmp_path / "site", manual_example("my_formats.py"), "drivezoo.formats"):
        yield


WRITTEN = ("udacity", "donkeycar", "mine")
EXACT = {name: TIMED_LABELS for name in WRITTEN} | {"mine": ("steering",)}  # to the bit


@pytest.fixture
def source(tmp_path: Path) -> Recording:
    return read_recordings(str(write_recording(tmp_path / "source", ROWS).folder))


@pytest.mark.usefixtures("outside")
@pytest.mark.parametrize("name", WRITTEN)
def test_a_written_format_is_read_back_equal(name: str, source: Recording, tmp_path: Path) -> None:
    check_written(name, source, tmp_path, EXACT[name])


def check_written(
    name: str, source: Recording, tmp_path: Path, exact: Sequence[str] = TIMED_LABELS
) -> None:
    """Check what a format writes, and the log of it, against the recording that was written."""
    shares: list[float] = []
    result = write_as(name, source, tmp_path / name, shares.append)
    assert (result.folder, result.rows) == (tmp_path / name, ROWS)
    assert min(shares) < 1
    assert all(0 <= share <= 1 for share in shares)
    assert [other for other, kind in formats().items() if kind.detect(tmp_path / name)] == [name]
    detected, kind = find_format(tmp_path / name)
    assert (detected, bool(kind.title)) == (name, True)
    recording = kind.read(tmp_path / name, ReadOptions())
    check_recording(recording, source)
    for column in exact:
        np.testing.assert_array_equal(getattr(recording, column), getattr(source, column), column)
    convert_to_recording(tmp_path / name, tmp_path / "log")
    check_recording(read_recordings(str(tmp_path / "log")), source)


@pytest.mark.usefixtures("outside")
def test_the_written_formats_are_all_that_write() -> None:
    assert {name for name in writable_formats() if name in (*OWN, "mine")} == set(WRITTEN)


@pytest.mark.parametrize("name", ["donkeycar", "udacity"])
def test_a_writer_replaces_and_leaves_nothing(name: str, source: Recording, tmp_path: Path) -> None:
    check_writer(name, source, tmp_path)


def check_writer(name: str, source: Recording, tmp_path: Path) -> None:
    """Check that a writer replaces no folder, and leaves none when it is stopped."""

    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_as(name, source, tmp_path / "new", stop)
    (tmp_path / "old").mkdir()
    with pytest.raises(InputError, match="exists"):
        write_as(name, source, tmp_path / "old")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["old", "source"]


def check_recording(recording: Recording, source: Recording) -> None:
    """Check all that the contract promises, against the recording that was written."""
    assert len(recording) == ROWS
    np.testing.assert_array_equal(recording.steering, source.steering)
    for column, low in ((recording.throttle, -1), (recording.brake, 0), (recording.speed_mph, 0)):
        assert column.dtype == float
        assert ((column >= low) & np.isfinite(column)).all()
    assert (recording.time_s.shape, recording.images.shape) == ((ROWS,), (ROWS, 3))
    for row in (3, 0, ROWS - 1):  # also backwards
        image = recording.image(row)
        assert (image.shape, image.dtype) == ((160, 320, 3), np.uint8)
        assert np.abs(image.astype(float) - source.image(row)).mean() < 3
    assert str(row + 1) in recording.place(row) or "jpg" in recording.place(row)
    assert recording.rig in (UDACITY, None)
    part = recording.keep(np.arange(ROWS) > 20)
    assert part.place(0) == recording.place(21)
    assert (part.image(0) == recording.image(21)).all()


def replace_once(old: str, new: str, file: str) -> Callable[[Path], None]:
    """Return a function that changes a text of a recording's file."""
    return lambda folder: replace_in(folder / file, old, new)


def cut_fourth_row(folder: Path) -> None:
    lines = (folder / "driving_log.csv").read_text().splitlines(keepends=True)
    lines[3] = lines[3][:50] + "\n"
    (folder / "driving_log.csv").write_text("".join(lines))


def ours(name: str) -> Callable[[Path], Path]:
    """Return a writer of 60 rows in a format that drivezoo writes."""

    def write_from_log(folder: Path) -> Path:
        log = write_recording(folder.parent / "of_log", foreign.ROWS)
        write_as(name, read_recordings(str(log.folder)), folder)
        return folder

    return write_from_log


spoil_a_record = replace_once('"_index": 3,', '"_index": 3', "catalog_0.catalog")
spoil_an_angle = replace_once(f"{foreign.NS}.jpg,-", f"{foreign.NS}.jpg,x", "interpolated.csv")
spoil_a_turn = replace_once("\\3.png,", "\\3.png,x", "my.csv")
COLUMNS = {"columns": {"image": "path", "steering": "turn"}, "format": "table"}
# A writer of a format, what makes one row bad, its place, and what the user says.
Example = tuple[Callable[[Path], Path], Callable[[Path], None], str, dict]
FORMATS: dict[str, Example] = {
    "udacity": (ours("udacity"), cut_fourth_row, r"driving_log\.csv, row 4", {}),
    "donkeycar": (ours("donkeycar"), spoil_a_record, r"catalog_0\.catalog, row 4", {}),
    "challenge2": (foreign.challenge2_training, spoil_an_angle, r"interpolated\.csv, row 62", {}),
    "table": (foreign.table, spoil_a_turn, r"my\.csv, row 5", COLUMNS),
}


def test_the_table_names_every_format() -> None:
    assert set(FORMATS) == set(OWN)


@pytest.mark.parametrize("name", FORMATS)
def test_a_bad_row_is_one_line_or_is_left_out_and_listed(name: str, tmp_path: Path) -> None:
    check_a_bad_row(name, FORMATS[name], tmp_path)


def check_a_bad_row(name: str, example: Example, tmp_path: Path) -> None:
    write, damage, pattern, options = example
    folder = str(write(tmp_path / "recording"))
    if not options:
        assert find_format(Path(folder))[0] == name
    whole = read_recordings(folder, **options)
    assert (len(whole), whole.bad_rows) == (foreign.ROWS, ())
    damage(Path(folder))
    with pytest.raises(InputError, match=rf"{pattern}[^\n]*on_bad_row=skip[^\n]*$"):
        read_recordings(folder, **options)
    rest = read_recordings(folder, **options, on_bad_row="skip")
    assert len(rest) + len(rest.bad_rows) == foreign.ROWS
    assert 1 <= len(rest.bad_rows) <= 2, "a missing signal is interpolated by both neighbours"
    assert re.search(pattern, rest.bad_rows[0])


@pytest.mark.parametrize("name", FORMATS)
def test_a_folder_of_images_is_taken_or_refused(name: str, tmp_path: Path) -> None:
    write, _, _, options = FORMATS[name]
    folder = write(tmp_path / "recording")
    if name not in ("udacity", "table"):
        check_a_refused_folder_of_images(folder, options)
        return
    images = str(shutil.copytree(folder, tmp_path / "elsewhere") / "IMG")
    if name == "table":
        images = str(tmp_path / "elsewhere")
    assert read_recordings(str(folder), **options, images=images).images[0, 0].startswith(images)


def check_a_refused_folder_of_images(folder: Path, options: dict) -> None:
    for key, value in (("images", str(folder.parent)), ("columns", {"image": "path"})):
        with pytest.raises(UsageError, match=rf"^{key}=.*leave {key}= out"):
            read_recordings(str(folder), **options, **{key: value})


def test_a_key_is_refused_if_no_recording_uses_it(source: Recording, tmp_path: Path) -> None:
    table, log = str(foreign.table(tmp_path / "table")), source.names[0]
    keys = {"speed_unit": "kmh", "columns": COLUMNS["columns"]}
    both = {"format": None, "each": {1: {"format": "table"}}}
    assert len(read_recordings([table, log], **keys, **both)) == foreign.ROWS + ROWS
    for key, value in {**keys, "steering": "left positive", "camera": "front"}.items():
        with pytest.raises(UsageError, match=rf"^{key}= .*udacity.*{re.escape(log)}"):
            read_recordings(log, **{key: value})


LOGS = {
    "udacity": "driving_log.csv",
    "donkeycar": "catalog_0.catalog",
    "challenge2": "interpolated.csv",
    "table": "my.csv",
}


@pytest.mark.parametrize("name", LOGS)
def test_a_last_line_that_is_being_written_is_no_error(name: str, tmp_path: Path) -> None:
    check_a_half_written_line(FORMATS[name], LOGS[name], tmp_path)


def check_a_half_written_line(example: Example, file: str, tmp_path: Path) -> None:
    write, _, _, options = example
    folder = write(tmp_path / "recording")
    lines = (folder / file).read_bytes().splitlines(keepends=True)
    half = lines[-1][: len(lines[-1]) // 2].rpartition(b",")[0]
    (folder / file).write_bytes(b"".join(lines) + half)
    again = read_recordings(str(folder), **options)
    assert (len(again), again.bad_rows) == (foreign.ROWS, ())


@pytest.mark.usefixtures("outside")
def test_damage_is_one_line_with_place_and_remedy(source: Recording, tmp_path: Path) -> None:
    write_as("mine", source, tmp_path / "mine")
    (tmp_path / "mine/00003_7.5.jpg").write_bytes(b"")
    with pytest.raises(InputError, match=r"00003_7\.5\.jpg: steering is 7\.5.*on_bad_row=skip"):
        convert_to_recording(tmp_path / "mine", tmp_path / "log")


def test_a_format_that_cannot_be_imported_is_named(source: Recording, tmp_path: Path) -> None:
    with installed(tmp_path / "site", "import no_such_module", "drivezoo.formats"):
        assert find_format(Path(source.names[0]))[0] == "udacity", "found before it is imported"
        with pytest.raises(InputError, match=r"outside_part: the format mine .*no_such_module"):
            find_format(tmp_path)


def edited(source: Recording, out: Path) -> None:
    write_edited(source, Edits(len(source)), out)


@pytest.mark.parametrize("name", ["edited", "udacity", "donkeycar"])
def test_a_copy_of_another_cars_recording_is_of_that_car(name: str, tmp_path: Path) -> None:
    check_copied_car(name, tmp_path)


def check_copied_car(name: str, tmp_path: Path) -> None:
    original = read_recordings(str(foreign.challenge2_training(tmp_path / "recording")))
    copy = edited if name == "edited" else partial(write_as, name)
    copy(original, tmp_path / "copy")
    again = read_recordings(str(tmp_path / "copy"))
    assert again.rig == original.rig
    assert again.blocks == original.blocks or name == "shards", "a shard is a block"
    assert other_car(again)
    np.testing.assert_array_equal(again.steering, original.steering)
    np.testing.assert_allclose(np.diff(again.time_s), np.diff(original.time_s), atol=0.002)
    assert np.abs(again.image(9).astype(float) - original.image(9)).mean() < 8


def test_a_copy_of_an_unknown_cars_recording_is_not_of_udacitys(tmp_path: Path) -> None:
    edited(read_recordings(str(foreign.table(tmp_path / "table")), **COLUMNS), tmp_path / "copy")
    again = read_recordings(str(tmp_path / "copy"))
    assert again.rig is None
    assert other_car(again) == "another_car"
