"""Films: an .mp4 that a browser plays."""

import contextlib
import errno
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tests.refusals import refusal
from zoo.base.errors import InputError
from zoo.base.video import Film, VideoWriter


def write(path: Path, *frames: np.ndarray) -> Path:
    with Film(path, fps=20) as film:
        for frame in frames:
            film.add(frame)
    return path


def read(path: Path) -> list[np.ndarray]:
    video, frames = cv2.VideoCapture(str(path)), []
    while (result := video.read())[0]:
        frames.append(cv2.cvtColor(result[1], cv2.COLOR_BGR2RGB))
    return frames


def grey(level: int, height: int = 160, width: int = 320) -> np.ndarray:
    return np.full((height, width, 3), level, np.uint8)


def test_a_browser_plays_a_film_before_it_has_the_whole_file(tmp_path: Path) -> None:
    data = write(tmp_path / "lap.mp4", *[grey(100)] * 5).read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")


def test_every_frame_is_there_in_order_and_folders_are_made(tmp_path: Path) -> None:
    levels = range(0, 200, 10)
    path = write(tmp_path / "films" / "of" / "today" / "lap.mp4", *map(grey, levels))
    assert list(path.parent.iterdir()) == [path], "nothing else is left there"
    frames = read(path)
    assert [frame.shape for frame in frames] == [(160, 320, 3)] * 20
    assert np.allclose([frame.mean() for frame in frames], levels, atol=6)


def test_colours_are_rgb_and_an_odd_row_and_column_are_cut_off(tmp_path: Path, capfd) -> None:
    red = np.broadcast_to(np.array((200, 40, 30), np.uint8), (161, 321, 3))
    frames = read(write(tmp_path / "odd.mp4", red, red))
    assert [frame.shape for frame in frames] == [(160, 320, 3)] * 2
    assert np.abs(frames[0].mean((0, 1)) - (200, 40, 30)).max() < 12
    assert capfd.readouterr() == ("", "")


def test_a_frame_of_another_size_is_named(tmp_path: Path) -> None:
    path = tmp_path / "lap.mp4"
    words = f"{path}: a frame is 320 x 80, the film is 320 x 160"
    assert words in refusal(write, path, grey(0), grey(10), grey(20, height=80))


def test_a_film_that_fails_leaves_the_one_before(tmp_path: Path) -> None:
    path = tmp_path / "lap.mp4"
    before = write(path, grey(0)).read_bytes()
    with contextlib.suppress(ZeroDivisionError), Film(path, fps=20) as film:
        film.add(grey(0, 16, 16))
        raise ZeroDivisionError
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_beside_a_film_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "secret.txt").write_text("mine")
    (tmp_path / ".lap.mp4.part.mp4").symlink_to(tmp_path / "secret.txt")
    write(tmp_path / "lap.mp4", grey(0))
    assert (tmp_path / "secret.txt").read_text() == "mine"


def test_a_film_without_a_frame_leaves_no_file(tmp_path: Path) -> None:
    write(tmp_path / "none.mp4")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_a_file_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "films").write_text("")
    assert "cannot be written" in refusal(Film, tmp_path / "films" / "lap.mp4", fps=20)


@pytest.mark.parametrize(
    ("small_disk", "frames"), [("8k", 1), ("1m", 400)], indirect=["small_disk"]
)
def test_a_full_disk_is_named_and_leaves_no_film(small_disk: Path, frames: int, capfd) -> None:
    path = small_disk / "lap.mp4"
    noise = np.random.default_rng(0).integers(0, 255, (160, 320, 3), np.uint8)
    with pytest.raises(InputError) as raised:
        write(path, *[np.roll(noise, number) for number in range(frames)])
    for words in (str(path), "disk is full", "free some space"):
        assert words in str(raised.value)
    assert "\n" not in str(raised.value)
    assert not list(small_disk.iterdir())
    assert capfd.readouterr() == ("", "")


def test_an_ffmpeg_that_is_killed_is_named(tmp_path: Path) -> None:
    film = Film(tmp_path / "lap.mp4", 20)
    film.add(grey(0))
    film._video._ffmpeg.kill()
    with pytest.raises(InputError, match=r"lap\.mp4.*signal: Killed"):
        film.__exit__(None, None, None)
    assert not list(tmp_path.iterdir())


def test_ctrl_c_on_windows_leaves_ffmpeg_to_complete_the_film(monkeypatch) -> None:
    started = SimpleNamespace(stdin=None)
    monkeypatch.setattr("subprocess.Popen", lambda _, **more: vars(started).update(more) or started)
    monkeypatch.setattr("zoo.base.video.NEW_GROUP", 512)
    VideoWriter(Path("lap.mp4"), "lap.mp4", (2, 2), 20, ())._messages.close()
    assert started.creationflags == 512


def test_dead_ffmpeg_is_named_on_windows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing to a broken pipe is EINVAL there."""
    film = Film(tmp_path / "lap.mp4", 20)
    film.add(grey(0))
    film._video._ffmpeg.kill()

    def write(*_: object) -> None:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(film._video, "_pipe", SimpleNamespace(write=write, close=write))
    with pytest.raises(InputError, match=r"lap\.mp4.*signal: Killed"), film:
        film.add(grey(0))
