"""`drivezoo check`, as a person runs it."""

import shlex
import subprocess
from pathlib import Path

import cv2
import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from datamodules.check import look_at_image
from tests.recordings import Written, write_recording
from tests.zoo.commands import ROOT, run_here


def run_check(*arguments: object) -> subprocess.CompletedProcess:
    return run_here(ROOT, *map(str, arguments), module="datamodules.check")


@pytest.fixture
def written(tmp_path: Path) -> Written:
    return write_recording(tmp_path / "my lake [1]", rows=12)


def cut_off(image: Path) -> None:
    image.write_bytes(image.read_bytes()[:-200])


def test_whole_recording(written):
    done = run_check(written.folder)
    report, sizes, verdict, *_ = done.stdout.splitlines()
    assert report.startswith(f"{written.folder}: 12 rows, 3 cameras")
    assert sizes == "36 images of 320 x 160"
    assert verdict == "all images are whole"
    assert (done.returncode, done.stderr) == (0, "")


def test_several_recordings(written, tmp_path):
    other = write_recording(tmp_path / "other", rows=4, cameras=("center",))
    done = run_check(written.folder, other.folder)
    assert [line.split(": ")[0] for line in done.stdout.splitlines()[:2]] == [
        str(written.folder),
        str(other.folder),
    ]
    assert "40 images of 320 x 160" in done.stdout


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
    assert f"{log}, row 6: {written.image(5)}: the file is no JPEG or PNG" in done.stdout
    assert f"{log}, row 8: no image {written.image(7, 'right').name}" in done.stdout
    assert "\n4 bad images; " in done.stdout
    assert done.stdout.splitlines()[-1].endswith(" data.on_bad_image=skip")


def test_after_twenty_bad_images_comes_a_count(written):
    for row in range(12):
        cut_off(written.image(row))
        cut_off(written.image(row, "left"))
    lines = run_check(written.folder).stdout.splitlines()
    assert len([line for line in lines if "truncated" in line]) == 20
    after = lines.index("and 4 more")
    assert lines[after + 1].startswith("24 bad images; ")


def test_other_image_sizes_are_counted(written):
    large = cv2.resize(cv2.imread(str(written.image(3))), (640, 320))
    cv2.imwrite(str(written.image(3)), large)
    done = run_check(written.folder)
    assert "35 images of 320 x 160\n" in done.stdout
    assert "1 image of 640 x 320\n" in done.stdout
    assert done.returncode == 0


@pytest.mark.parametrize("broken", ["folder", "log"])
def test_what_cannot_be_read_is_one_line_on_stderr(written, broken):
    folder = written.folder
    if broken == "folder":
        folder = folder / "nowhere"
    else:
        written.log.unlink()
    done = run_check(folder)
    assert done.returncode == 1
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"drivezoo check: {folder}")


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
    folder = write_recording(tmp_path / "my lake", rows=2).folder
    images = folder / "IMG"
    see, train = run_check(folder, f"images={images}").stdout.splitlines()[-2:]
    keys = [f"data.root={folder}", f"data.images={images}"]
    assert shlex.split(see.partition(": ")[2]) == ["drivezoo", "preview", *keys]
    assert shlex.split(train.partition(": ")[2]) == [
        "drivezoo",
        "train",
        "experiment=first_try",
        *keys,
    ]


def test_the_next_command_names_several_folders_in_hydras_grammar(tmp_path):
    folders = [str(write_recording(tmp_path / one, rows=2).folder) for one in ("a", "b's [2]")]
    command = shlex.split(run_check(*folders).stdout.splitlines()[-1].partition(": ")[2])
    _, override = OverridesParser.create().parse_overrides(command[2:])
    assert (override.key_or_group, override.value()) == ("data.root", folders)


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
    refused = run_check(written.folder)
    assert refused.returncode == 1
    after = refused.stdout.splitlines().index("skipped 1 bad rows:")
    assert "row 4: 1 columns, expected 7" in refused.stdout.splitlines()[after + 1]
    assert refused.stdout.splitlines()[-1].endswith(" data.on_bad_row=skip")
    for option in ("on_bad_row=skip", "data.on_bad_row=skip", "--on-bad-row=skip"):
        skipped = run_check(written.folder, option)
        assert skipped.returncode == 0
        after = skipped.stdout.splitlines().index("skipped 1 bad rows:")
        assert "row 4: 1 columns" in skipped.stdout.splitlines()[after + 1]
        assert skipped.stdout.splitlines()[-1].endswith(" data.on_bad_row=skip")
