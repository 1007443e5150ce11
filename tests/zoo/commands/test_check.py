"""`drivezoo check`, as a person runs it."""

import re
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from datamodules.looking.leak import leak_lines
from datamodules.recording_format import read_recordings
from tests.datamodules.test_other_kinds import POINTER
from tests.foreign_recordings import challenge2_test, driving_log, table, write_frames
from tests.recordings import Written, recording_in_memory, write_as, write_recording
from tests.zoo.command_runs import ROOT, only_line, run_here
from zoo.commands.check import look_at_image


def run_check(*arguments: object) -> subprocess.CompletedProcess:
    return run_here(ROOT, *map(str, arguments), module="zoo.commands.check")


@pytest.fixture
def written(tmp_path: Path) -> Written:
    return write_recording(tmp_path / "my lake [1]", rows=12)


def cut_off(image: Path) -> None:
    image.write_bytes(image.read_bytes()[:-200])


def test_whole_recording(written):
    done = run_check(written.folder)
    report, sign, sizes, verdict, *_ = done.stdout.splitlines()
    assert report.startswith(f"{written.folder}: 12 rows, 3 cameras")
    assert "do not move enough to tell left from right" in sign
    assert sizes == "36 images of 320 x 160"
    assert verdict == "all images are whole"
    assert (done.returncode, done.stderr) == (0, "")


def as_tub(folder: Path, right: float) -> Path:
    tub = folder.with_name(f"{folder.name} tub")
    write_as("donkeycar", read_recordings(str(driving_log(folder, right))), tub)
    return tub


def as_another_car(folder: Path, right: float) -> Path:
    (driving_log(folder, right) / "rig.yaml").write_text(
        "{name: ours, camera: {size: [160, 80], vertical_fov_deg: 60, up_m: 1}, "
        "wheelbase_m: 1, steering_deg: 30}"
    )
    return folder


@pytest.mark.parametrize("write", [driving_log, as_tub, as_another_car])
def test_left_and_right_are_compared_with_the_images_of_every_recording(
    write: Callable[[Path, float], Path], tmp_path: Path
) -> None:
    right, wrong = write(tmp_path / "right", 1.0), write(tmp_path / "wrong", -1.0)
    lines = run_check(right, wrong).stdout.splitlines()
    assert any(line.startswith(f"{right}: left and right fit the images") for line in lines)
    assert any(line.startswith(f"{wrong}: LEFT AND RIGHT SEEM EXCHANGED") for line in lines)
    assert run_check(right).stdout.splitlines()[-1].startswith("next: drivezoo train")


@pytest.mark.parametrize("given", [[], ["steering={unit: share, right: positive}"]])
@pytest.mark.parametrize("others", [(), (1.0,)])
def test_the_next_command_turns_the_sign(tmp_path: Path, given: list[str], others: tuple) -> None:
    folders = [driving_log(tmp_path / "wrong", -1.0)]
    folders += [driving_log(tmp_path / "right", right) for right in others]
    for _ in range(2):
        last = run_check(*folders, *given).stdout.splitlines()[-1]
        program, command, *given = shlex.split(last.removeprefix("next: "))
        assert program == "drivezoo"
        if command == "check":
            given = given[len(folders) :]
    assert command == "train"


def test_the_next_command_keeps_each_unit_and_what_was_said(tmp_path: Path) -> None:
    wrong, units = challenge2_test(tmp_path / "wrong"), table(tmp_path / "units")
    names = sorted(path.name for path in (wrong / "center").iterdir())
    write_frames(wrong / "center", names, right=-1.0)
    said = "format: table, columns: {image: path, steering: turn}"
    for folders, given, key in (
        ([wrong], [], "steering={unit: rad, full: 8.2, right: positive, zero: 0.0}"),
        ([units, wrong], [f"each={{1: {{{said}}}}}"], f"each={{1: {{{said}}}, 2: {{steering: {{"),
    ):
        last = run_check(*folders, *given).stdout.splitlines()[-1]
        command, *words = shlex.split(last.removeprefix("next: drivezoo "))
        assert command == "check"
        assert words[-1].startswith(key)
        assert "next: drivezoo train" in run_check(*words).stdout


def test_several_recordings(written, tmp_path):
    other = write_recording(tmp_path / "other", rows=4, cameras=("center",))
    folders = [str(written.folder), str(other.folder)]
    printed = run_check(*folders).stdout
    assert [line.split(": ")[0] for line in printed.splitlines()[:4]] == 2 * folders
    assert "40 images of 320 x 160" in printed


def test_images_elsewhere(written, tmp_path):
    elsewhere = (written.folder / "IMG").rename(tmp_path / "images")
    assert run_check(written.folder).returncode == 1
    assert run_check(written.folder, f"--images={elsewhere}").returncode == 0
    same = run_check(f"data.root={written.folder}", f"data.images={elsewhere}")
    assert same.returncode == 0


def test_each_bad_image_is_named_with_its_row(written):
    cut_off(written.image(2, "left"))
    written.image(4).write_bytes(b"")
    written.image(5).write_bytes(b"version https://git-lfs.github.com/spec/v1")
    written.image(7, "right").unlink()
    done = run_check(written.folder)
    log = written.log
    assert done.returncode == 1
    assert f"{log}, row 3: {written.image(2, 'left')}: the image is truncated" in done.stdout
    assert f"{log}, row 5: {written.image(4)}: the file is empty" in done.stdout
    assert f"{log}, row 6: {written.image(5)}: is a Git LFS pointer" in done.stdout
    assert f"{log}, row 8: no image {written.image(7, 'right').name}" in done.stdout
    assert "\n4 bad images; " in done.stdout
    assert done.stdout.splitlines()[-1].endswith(" data.on_bad_image=skip")


def test_one_bad_image_is_counted_as_one(written):
    cut_off(written.image(3))
    assert "\n1 bad image; " in run_check(written.folder).stdout


def test_after_twenty_bad_images_comes_a_count(written):
    for row in range(12):
        cut_off(written.image(row))
        cut_off(written.image(row, "left"))
    lines = run_check(written.folder).stdout.splitlines()
    assert len([line for line in lines if "truncated" in line]) == 20
    after = lines.index("and 4 more")
    assert lines[after + 1].startswith("24 bad images; ")


def test_findings_are_those_of_rows_with_whole_images(written):
    """Equal damaged images are no repeated ones, and a steering beside them teaches nothing."""
    for row in range(11):
        written.image(row).write_bytes(POINTER)
    lines = run_check(written.folder).stdout.splitlines()
    assert not [line for line in lines if "repeat the row before" in line]
    assert [line for line in lines if line.startswith("- only 1 row:")]


def test_without_a_whole_image_there_are_no_findings_and_no_next_command(written, tmp_path):
    for image in written.folder.glob("IMG/*.jpg"):
        image.write_bytes(POINTER)
    done = run_check(written.folder, challenge2_test(tmp_path / "road"))
    assert (done.returncode, done.stderr) == (1, "")
    assert "36 bad images; " in done.stdout
    assert [line for line in done.stdout.splitlines() if line.startswith("- only 60 rows")]
    done = run_check(written.folder)
    lines = done.stdout.splitlines()
    assert done.returncode == 1
    assert lines[-1].startswith("36 bad images; no row is without one")
    assert "git lfs pull" in lines[1]


def test_the_size_of_a_turned_image_is_that_which_is_trained_on(written):
    for image in written.folder.glob("IMG/*.jpg"):
        data = image.read_bytes()
        exif = b"Exif\0\0MM\0*\0\0\0\10\0\1\1\22\0\3\0\0\0\1\0\6\0\0\0\0\0\0"
        image.write_bytes(data[:2] + b"\xff\xe1\0\x22" + exif + data[2:])
        assert cv2.imread(str(image)).shape == (320, 160, 3)
    assert "36 images of 160 x 320" in run_check(written.folder).stdout


def test_other_image_sizes_are_counted(written):
    path = str(written.image(3))
    cv2.imwrite(path, cv2.resize(cv2.imread(path), (640, 320)))
    done = run_check(written.folder)
    assert "35 images of 320 x 160\n" in done.stdout
    assert "1 image of 640 x 320\n" in done.stdout
    assert done.returncode == 0


def test_a_folder_without_its_log_is_one_line_on_stderr(written):
    written.log.unlink()
    done = run_check(written.folder)
    assert done.stdout == ""
    assert only_line(done, 1).startswith(f"drivezoo check: {written.folder}")


@pytest.mark.parametrize("name", ["x[/red]", "Straße ï :car: [bold]", "a 'b' \\[c", "lr=0.1,x"])
def test_a_folder_is_printed_as_it_is_named(tmp_path, name):
    folder = write_recording(tmp_path / name, rows=2).folder
    done = run_check(folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{folder}: 2 rows")


def test_oddities_follow_the_figures_and_are_no_fault(tmp_path):
    folder = write_recording(tmp_path / "lake", rows=4, cameras=("center",)).folder
    done = run_check(folder)
    lines = done.stdout.splitlines()
    heading = lines.index("before you train:")
    assert heading > lines.index("all images are whole")
    assert "quick=true" in lines[heading + 1]
    assert "augment=[shift]" in lines[heading + 2]
    assert done.returncode == 0


def test_the_next_commands_close(tmp_path):
    folder = write_recording(tmp_path / "my lake", rows=60).folder
    images = folder / "IMG"
    see, train = run_check(folder, f"images={images}").stdout.splitlines()[-2:]
    keys = [f"data.root={folder}", f"data.images={images}"]
    assert shlex.split(see.partition(": ")[2]) == ["drivezoo", "preview", *keys]
    training = ["drivezoo", "train", "experiment=first_try", *keys]
    assert shlex.split(train.partition(": ")[2]) == training


def test_the_advice_on_held_out_rows_is_no_other_command_than_the_next() -> None:
    (line,) = leak_lines(recording_in_memory(0.5 * np.sin(np.arange(900) / 200)))
    assert line.endswith("; judge by drives, or add data.split=blocks")


def test_the_next_command_names_several_folders_in_hydras_grammar(tmp_path):
    folders = [str(write_recording(tmp_path / name, rows=60).folder) for name in ("a", "b's [2]")]
    command = shlex.split(run_check(*folders).stdout.splitlines()[-1].partition(": ")[2])
    _, override = OverridesParser.create().parse_overrides(command[2:])
    assert (override.key_or_group, override.value()) == ("data.root", folders)


def write_short(folder: Path) -> Path:
    log = driving_log(folder) / "driving_log.csv"
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:2]))
    return folder


def write_cut_off(folder: Path) -> Path:
    for image in (driving_log(folder) / "IMG").iterdir():
        cut_off(image)
    return folder


def test_the_next_commands_hold_a_recording_without_bends(tmp_path: Path) -> None:
    log = driving_log(tmp_path / "straight") / "driving_log.csv"
    images = [line.split(",")[0] for line in log.read_text().splitlines()]
    log.write_text("".join(f"{image},,,0.01,0.2,0,9\n" for image in images))
    see, train = run_check(log.parent).stdout.splitlines()[-2:]
    assert see.endswith(" data.straight_cap=null")
    assert train.endswith(" data.straight_cap=null")
    assert "straight_cap" not in run_check(driving_log(tmp_path / "bends")).stdout.splitlines()[-1]


@pytest.mark.parametrize(
    ("write", "reason"), [(write_short, "no training yet: data.split"), (write_cut_off, "60 bad")]
)
def test_no_next_command_stops(write: Callable[[Path], Path], reason: str, tmp_path: Path) -> None:
    printed = run_check(write(tmp_path / "recording")).stdout
    assert reason in printed
    assert "next: drivezoo train" not in printed
    assert "on_bad_image" not in printed


def test_png_is_whole_or_truncated(written, tmp_path):
    image = tmp_path / "center.png"
    cv2.imwrite(str(image), cv2.imread(str(written.image(0))))
    assert look_at_image(str(image)) == (320, 160)
    cut_off(image)
    assert look_at_image(str(image)) == "the image is truncated"


def test_bad_rows_are_named_with_the_command_that_skips_them(written):
    lines = written.log.read_text().splitlines()
    lines[3] = lines[3][:50]
    written.log.write_text("\n".join(lines) + "\n")
    options = ("on_bad_row=fail", "on_bad_row=skip", "data.on_bad_row=skip", "--on-bad-row=skip")
    for option in options:
        done = run_check(written.folder, option)
        assert done.returncode == ("fail" in option)
        assert re.search("\nskipped 1 bad row:\n.*row 4: 1 columns, expected 7", done.stdout)
        assert done.stdout.splitlines()[-1].endswith(" data.on_bad_row=skip")


def test_a_steering_in_another_unit_leads_to_its_key_and_to_no_training(written):
    rows = [line.split(",") for line in written.log.read_text().splitlines()]
    turned = [[*row[:3], str(25 * float(row[3])), *row[4:]] for row in rows]
    written.log.write_text("".join(f"{','.join(row)}\n" for row in turned))
    lines = run_check(written.folder).stdout.splitlines()
    assert any("data.steering={unit" in line for line in lines)
    assert re.match("no training yet: .*data.steering", lines[-1])
