"""Donkeycar tubs: a recording there and back, foreign tubs, and tubs that are damaged."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.format_options import ReadOptions
from datamodules.image import read_image
from datamodules.looking.findings import report_recordings
from datamodules.recorded_car import read_source
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from datamodules.stretches import find_breaks, missing_rows
from tests.recordings import Written, convert_to_recording, write_as
from tests.refusals import refusal
from zoo.base.errors import InputError
from zoo.commands.convert import convert


@pytest.fixture(scope="module")
def tub(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a tub of 40 rows with a pause after row 20."""
    whole = read_recordings(str(recorded.folder))
    out = tmp_path_factory.mktemp("tubs") / "tub"
    write_as("donkeycar", whole.keep(np.isin(np.arange(len(whole)), np.r_[0:20, 60:80])), out)
    return out


def write_lines(path: Path, values: list) -> None:
    path.write_text("".join(f"{json.dumps(value)}\n" for value in values))


def write_tub(folder: Path, records: list[dict], deleted: tuple[int, ...] = ()) -> Path:
    """Write a tub as Donkeycar does, two records in a catalog; images are 160 x 120."""
    (folder / "images").mkdir(parents=True)
    names = []
    for first in range(0, len(records), 2):
        names.append(f"catalog_{len(names)}.catalog")
        write_lines(folder / names[-1], records[first : first + 2])
    catalogs = {"paths": names, "current_index": len(records), "max_len": 2}
    catalogs["deleted_indexes"] = list(deleted)
    write_lines(folder / "manifest.json", [["cam/image_array"], ["image_array"], {}, {}, catalogs])
    for index in range(len(records)):
        image = np.full((120, 160, 3), 20 * index, np.uint8)
        cv2.imwrite(str(folder / "images" / f"{index}_cam_image_array_.jpg"), image)
    return folder


@pytest.fixture
def small(tmp_path: Path) -> Path:
    return write_tub(tmp_path / "tub", [record(0), record(1)])


def record(index: int, **changed: object) -> dict:
    content = {
        "cam/image_array": f"{index}_cam_image_array_.jpg",
        "user/angle": index / 10,
        "user/throttle": 0.3,
        "user/mode": "user",
        "_index": index,
        "_session_id": "21-05-01_0",
        "_timestamp_ms": 1_600_000_000_000 + 50 * index,
    }
    return content | {key.replace("__", "/"): value for key, value in changed.items()}


def test_images_return_to_the_bit_and_pauses(recorded: Written, tub: Path, tmp_path: Path) -> None:
    result = convert_to_recording(tub, tmp_path / "again")
    again = read_recordings(str(tmp_path / "again"))
    for new, row in zip(again.images[:, 0], [*range(20), *range(60, 80)], strict=True):
        assert Path(new).read_bytes() == recorded.image(row).read_bytes()
    assert np.flatnonzero(find_breaks(again)).tolist() == [19]
    assert (result.rows, result.drives) == (40, 2)


def test_the_tub_has_donkeycars_keys(recorded: Written, tub: Path) -> None:
    lines = (tub / "manifest.json").read_text().splitlines()
    inputs, types, _, about, catalogs = map(json.loads, lines)
    assert dict(zip(inputs, types, strict=True))["cam/image_array"] == "image_array"
    assert (about["sessions"]["last_id"], catalogs["current_index"]) == (1, 40)
    rows = (tub / "catalog_0.catalog").read_text().splitlines(keepends=True)
    lengths = json.loads((tub / "catalog_0.catalog_manifest").read_text())["line_lengths"]
    assert lengths == [len(row) for row in rows]
    first = json.loads(rows[0])
    assert first["user/angle"] == recorded.steering[0]
    assert first["user/throttle"] == recorded.throttle[0] - recorded.brake[0]
    assert first["enc/speed"] == pytest.approx(recorded.speed_mph[0] * 0.44704)
    assert (tub / "images" / first["cam/image_array"]).is_file()


def test_deleted_and_autopilot_records_are_left_out(tmp_path: Path) -> None:
    records = [record(0), record(1), record(2, user__mode="local"), record(3), record(4)]
    tub = write_tub(tmp_path / "tub", records, deleted=(1, 4))
    result = convert_to_recording(tub, tmp_path / "new")
    new = read_recordings(str(tmp_path / "new"))
    assert (new.steering.tolist(), new.time_s[0]) == ([0.0, 0.3], 1_600_000_000.0)
    notes = "\n".join(result.notes)
    assert "2 records left out that the tub marks as deleted" in notes
    assert "1 record left out that an autopilot drove" in notes
    assert "no speed" in notes


@pytest.mark.parametrize("is_old", [False, True])
def test_no_window_reaches_over_a_record_that_is_left_out(is_old: bool, tmp_path: Path) -> None:
    records = [record(number, user__angle=0.1) for number in range(12)]
    for each in records:
        del each["_timestamp_ms"]
    tub = write_tub(tmp_path / "tub", records, deleted=tuple(range(3, 9)))
    if is_old:
        for path in (tub / "manifest.json", *tub.glob("*.catalog")):
            path.unlink()
        for number in (0, 1, 2, 9, 10, 11):
            (tub / f"record_{number}.json").write_text(json.dumps(records[number]))
            image = records[number]["cam/image_array"]
            (tub / "images" / image).rename(tub / image)
    recording = read_recordings(str(tub))
    assert np.diff(recording.time_s) == pytest.approx([0.05, 0.05, 0.35, 0.05, 0.05], abs=1e-6)
    assert missing_rows(recording).tolist() == [False, False, True, False, False]


@pytest.mark.parametrize(("unit_ms", "step_s"), [(1, 0.05), (1, 5.0), (1000, 0.05)])
def test_times_in_seconds_are_known_by_steps(unit_ms: int, step_s: float, tmp_path: Path) -> None:
    times = [1_600_000_000_000 / unit_ms + row * step_s * 1000 / unit_ms for row in range(6)]
    records = [record(row, _timestamp_ms=time) for row, time in enumerate(times)]
    recording = read_recordings(str(write_tub(tmp_path / "tub", records)))
    assert recording.time_s == pytest.approx(1.6e9 + step_s * np.arange(6), abs=1e-3)


def test_records_without_a_time_are_counted(tmp_path: Path) -> None:
    records = [record(number) for number in range(4)]
    del records[2]["_timestamp_ms"]
    (note, _) = read_recordings(str(write_tub(tmp_path / "tub", records))).notes
    assert note.endswith("1 record without a time: 20 a second are assumed")


def test_what_is_no_image_is_left_out_and_counted(tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", [record(0), record(1), record(2)])
    (tmp_path / "secret.txt").write_text("not an image")
    (tub / "images" / "1_cam_image_array_.jpg").write_bytes(b"\xff\xd8\xff")
    (tub / "images" / "2_cam_image_array_.jpg").unlink()
    (tub / "images" / "2_cam_image_array_.jpg").symlink_to(tmp_path / "secret.txt")
    result = convert_to_recording(tub, tmp_path / "new")
    assert result.rows == len(list((tmp_path / "new" / "IMG").iterdir())) == 1
    assert "2 rows left out" in result.notes[0]
    assert "catalog_0.catalog, row 2" in result.notes[0]
    with pytest.raises(InputError, match=r"row 2: .*2 of 3 rows.*data\.on_bad_image=skip"):
        read_recordings(str(tub))


@pytest.mark.parametrize(
    ("to", "size"), [("udacity", None), ("donkeycar", None), ("udacity", (60, 120))]
)
def test_padding_keeps_an_odd_sizes_shape(to: str, size: tuple | None, tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", [record(0), record(9)])
    cv2.imwrite(str(tub / "images" / "9_cam_image_array_.jpg"), np.full((120, 160, 3), 180))
    convert_to_recording(tub, tmp_path / "kept")
    source = str(tub if to == "udacity" else tmp_path / "kept")
    convert(source, to=to, out=tmp_path / "padded", fit="pad", size=size)
    odd, padded = (read_recordings(str(tmp_path / fit)).images[1, 0] for fit in ("kept", "padded"))
    assert cv2.imread(odd).shape == (120, 160, 3)
    seen = read_image(padded)
    assert seen.shape[:2] == (size or (120, 240))
    assert seen[:, : seen.shape[1] // 8].max() < 30, "a black bar"
    assert abs(seen[:, seen.shape[1] // 2].mean() - 180) < 3


def test_a_tub_of_donkeycar_3_is_read(tmp_path: Path) -> None:
    tub = tmp_path / "old"
    tub.mkdir()
    for index in (1, 2, 10):
        cv2.imwrite(str(tub / f"{index}_cam.jpg"), np.full((120, 160, 3), index, np.uint8))
        content = {"cam/image_array": f"{index}_cam.jpg", "user/angle": index / 100}
        content |= {"user/throttle": -0.5, "milliseconds": 100 * index}
        (tub / f"record_{index}.json").write_text(json.dumps(content))
    convert_to_recording(tub, tmp_path / "new")
    new = read_recordings(str(tmp_path / "new"))
    assert (new.steering.tolist(), new.throttle.tolist()) == ([0.01, 0.02, 0.1], [-0.5] * 3)
    assert np.diff(new.time_s) == pytest.approx([0.1, 0.8])


def test_a_tub_is_of_another_car_unless_drivezoo_wrote_it(tub: Path, tmp_path: Path) -> None:
    convert_to_recording(tub, tmp_path / "ours")
    convert_to_recording(write_tub(tmp_path / "tub", [record(0), record(1)]), tmp_path / "theirs")
    assert read_source([tmp_path / "ours"]) is None
    assert read_source([tmp_path / "ours", tmp_path / "theirs"]) == "donkeycar"
    (tmp_path / "theirs" / "source.json").write_text("[]")
    with pytest.raises(InputError, match=r"source\.json: format"):
        read_source([tmp_path / "theirs"])


def refuse(tub: Path, words: str) -> None:
    """Check that a tub is refused in one line, and that nothing is written."""
    assert words in refusal(convert_to_recording, tub, tub.with_name("new"))
    assert [path.name for path in tub.parent.iterdir()] == [tub.name]


SECOND_RECORDS = [
    ('{"user/angle": 0.', "catalog_0.catalog, row 2: no JSON"),
    ("[" * 100_000, "catalog_0.catalog, row 2: no JSON"),
    ("[1]", "row 2: expected an object"),
    (json.dumps(record(1, user__angle="left")), "row 2: user/angle"),
    (json.dumps(record(1, user__angle=10**400)), "row 2: user/angle"),
    (json.dumps(record(1, user__angle=1.5)), "beyond -1..1"),
    (json.dumps(record(1, _timestamp_ms=-5)), "between 1970"),
    (json.dumps(record(1, cam__image_array="../../secret.jpg")), "row 2: cam/image_array"),
]


@pytest.mark.parametrize(("text", "words"), SECOND_RECORDS, ids=range(len(SECOND_RECORDS)))
def test_a_damaged_record_is_named_in_one_line(text: str, words: str, small: Path) -> None:
    (small / "catalog_0.catalog").write_text(f"{json.dumps(record(0))}\n{text}\n")
    refuse(small, words)


@pytest.mark.parametrize(
    ("paths", "words"),
    [
        (["../other.catalog"], "a catalog"),
        (["/etc/passwd"], "a catalog"),
        (["nowhere.catalog"], "the catalog nowhere.catalog"),
        (["catalog_0.catalog"] * 800, "names a catalog more than"),
        (7, "no lists"),
    ],
)
def test_wrong_names_of_catalogs_are_refused(paths: object, words: str, small: Path) -> None:
    write_lines(small / "manifest.json", [[], [], {}, {}, {"paths": paths}])
    refuse(small, f"manifest.json, row 5: {words}")


def test_a_file_of_a_tub_that_is_cut_short_or_a_pipe_is_named(small: Path) -> None:
    (small / "catalog_0.catalog").unlink()
    os.mkfifo(small / "catalog_0.catalog")
    refuse(small, "no regular file")
    (small / "manifest.json").write_text("[]\n")
    refuse(small, "manifest.json, row 5: no JSON")


def test_a_recording_without_times_gets_some(recorded: Written, tmp_path: Path) -> None:
    whole = read_recordings(str(recorded.folder))
    timeless = Recording(**{**vars(whole), "time_s": np.full(len(whole), np.nan)})
    write_as("donkeycar", timeless, tmp_path / "tub")
    convert_to_recording(tmp_path / "tub", tmp_path / "new")
    assert np.diff(read_recordings(str(tmp_path / "new")).time_s) == pytest.approx(1 / 15, abs=1e-3)


def test_two_corrupt_records_are_counted_and_can_be_skipped(tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", [record(row) for row in range(8)])
    cut, garbled = tub / "catalog_1.catalog", tub / "catalog_2.catalog"
    cut.write_bytes(cut.read_bytes()[:-40] + b"\n")
    garbled.write_bytes(garbled.read_bytes().replace(b"21-05", b"21\xff05", 1))
    words = r"catalog_1\.catalog, row 2: .*2 of 8 rows.*on_bad_row=skip"
    with pytest.raises(InputError, match=words) as caught:
        convert_to_recording(tub, tmp_path / "out")
    assert str(caught.value).count("delete") == 1, "one remedy"
    assert not (tmp_path / "out").exists()
    result = convert_to_recording(tub, tmp_path / "out", options=ReadOptions(on_bad_row="skip"))
    assert read_recordings(str(tmp_path / "out")).steering.tolist() == [0, 0.1, 0.2, 0.5, 0.6, 0.7]
    assert result.notes[0].startswith("2 rows left out: ")
    assert "catalog_1.catalog, row 2" in result.notes[0]


@pytest.mark.parametrize("angles", [[0, 4, 8, 12], [0, -25, 0, -25]], ids=["wheel", "keyboard"])
def test_angles_in_degrees_have_one_remedy_for_all_rows(angles: list[int], tmp_path: Path) -> None:
    changed = [record(row, user__angle=angle) for row, angle in enumerate(angles)]
    tub = write_tub(tmp_path / "tub", changed)
    with pytest.raises(InputError, match=r"degrees.*data\.steering=\{unit: deg") as caught:
        convert_to_recording(tub, tmp_path / "out")
    assert "delete" not in str(caught.value)


@pytest.mark.parametrize(
    ("records", "deleted", "words", "unsaid"),
    [
        ([], (), "the tub has no records", ("deleted", "autopilot", "image")),
        ([record(0), record(1)], (0, 1), "2 deleted;", ("autopilot", "image")),
        ([record(0, user__mode="local")], (), "1 driven by an autopilot;", ("deleted", "image")),
        ([record(0), record(1, user__mode="local")], (0,), "1 deleted, 1 driven", ("image",)),
    ],
)
def test_a_tub_without_records_left_names_what_was_left_out(
    records: list, deleted: tuple, words: str, unsaid: tuple, tmp_path: Path
) -> None:
    line = refusal(read_recordings, str(write_tub(tmp_path / "tub", records, deleted)))
    assert words in line
    assert not [word for word in unsaid if word in line]


@pytest.mark.parametrize("ending", [".bmp", ".tif", ".webp"])
def test_images_of_another_kind_are_named(ending: str, small: Path) -> None:
    for image in (small / "images").iterdir():
        image.write_bytes(cv2.imencode(ending, np.zeros((9, 9, 3), np.uint8))[1].tobytes())
    with pytest.raises(InputError, match=r"of another kind.*\(2 of 2 rows.*; copy .* again$"):
        read_recordings(str(small))


def test_drives_are_counted_by_the_gaps_that_check_counts(tmp_path: Path) -> None:
    """One session with two gaps of time is three drives."""
    late = [record(n, _timestamp_ms=1_600_000_000_000 + 5000 * (n // 2)) for n in range(6)]
    result = convert_to_recording(write_tub(tmp_path / "tub", late), tmp_path / "out")
    (report,) = report_recordings(read_recordings(str(tmp_path / "out")))
    assert (result.drives, report.gaps) == (3, 2)


def test_a_forks_keys_are_read(tmp_path: Path) -> None:
    """Forks write `steering` and `throttle`, and no mode."""
    plain = [record(index) for index in range(4)]
    keys = {"user/angle": "steering", "user/throttle": "throttle"}
    forked = [{keys.get(name, name): row[name] for name in row} for row in plain]
    recording = read_recordings(str(write_tub(tmp_path / "tub", forked)))
    assert recording.steering.tolist() == [0.0, 0.1, 0.2, 0.3]
    assert recording.throttle.tolist() == [0.3] * 4
