import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from datamodules import row_views
from datamodules.image import decode_image
from datamodules.recording_format import read_recordings
from datamodules.row_views import load_row_views
from datamodules.view import View
from tests.recordings import write_recording

VIEW = View((60, 25), "rgb", (33, 100))
CAMERAS = ["center", "left", "right"]


def view_of(path: Path | str) -> np.ndarray:
    return VIEW(decode_image(Path(path).read_bytes()))


@pytest.fixture
def two(tmp_path):
    """Write a recording with three cameras and one with only the centre camera."""
    return [
        write_recording(tmp_path / "one", rows=8, seed=1),
        write_recording(tmp_path / "two", rows=6, seed=2, cameras=("center",)),
    ]


def roots(written) -> list[str]:
    return [str(recording.folder) for recording in written]


def test_a_folders_name_is_no_markup_of_the_progress_bar(tmp_path):
    written = write_recording(tmp_path / "x[/red]", rows=2)
    console = Console(file=io.StringIO(), force_terminal=True, width=200)
    load_row_views(read_recordings(str(written.folder)), CAMERAS, VIEW, None, console)
    assert "x[/red], right" in console.file.getvalue()


def test_images_of_one_camera_for_all_rows_are_copies(two, console):
    views, _ = load_row_views(read_recordings(roots(two)), CAMERAS, VIEW, None, console)
    for _ in range(2):
        images = views.take(np.arange(14), 0)
        np.testing.assert_array_equal(images[9], view_of(two[1].image(1)))
        images[:] = 0


def test_kept_rows_keep_their_images(two, console):
    views, _ = load_row_views(read_recordings(roots(two)), CAMERAS, VIEW, None, console)
    mask = np.ones(14, dtype=bool)
    mask[[0, 9]] = False
    part = views.keep(mask)
    np.testing.assert_array_equal(part.take(np.arange(12), 0), views.take(np.flatnonzero(mask), 0))


def test_a_bad_image_is_named_by_its_row(two, console):
    bad = two[0].image(4, "left")
    bad.write_bytes(bad.read_bytes()[:500])
    recording = read_recordings(roots(two)[::-1])  # the second's six rows come first
    _, faults = load_row_views(recording, CAMERAS, VIEW, None, console)
    assert faults == {10: f"{bad}: the image is truncated"}


def test_one_more_recording_leaves_the_others_views_alone(two, tmp_path, console):
    cache = tmp_path / "cache"
    load_row_views(read_recordings(roots(two)[:1]), CAMERAS, VIEW, cache, console)
    before = {path: path.stat().st_mtime_ns for path in cache.glob("*.npy")}
    assert len(before) == 3
    load_row_views(read_recordings(roots(two)), CAMERAS, VIEW, cache, console)
    after = {path: path.stat().st_mtime_ns for path in cache.glob("*.npy")}
    assert len(after) == 4
    assert before.items() <= after.items()


@pytest.mark.parametrize("resident", [True, False])
@pytest.mark.parametrize("size", [(33, 100), (6, 20)], ids=["large", "small"])
def test_plain_and_mirrored_images_by_row(two, tmp_path, console, monkeypatch, size, resident):
    if not resident:
        monkeypatch.setattr(row_views, "RESIDENT_BYTES", 0)
    view = View((60, 25), "rgb", size)
    recording = read_recordings(roots(two))
    views, faults = load_row_views(recording, CAMERAS, view, tmp_path / "cache", console)
    assert faults == {}
    assert (len(views.files) == 1) == resident
    rows, cameras = np.array([13, 2, 2, 7]), np.array([0, 1, 1, 2])
    plain = views.take(rows, cameras)
    turned = views.take(rows, cameras, np.array([True, False, True, False]))
    np.testing.assert_array_equal(turned[[0, 2]], plain[[0, 2]][:, :, ::-1])
    np.testing.assert_array_equal(turned[[1, 3]], plain[[1, 3]])
    for image, row, camera in zip(plain, rows, cameras, strict=True):
        whole = decode_image(Path(recording.images[row, camera]).read_bytes())
        np.testing.assert_array_equal(image, view(whole))
