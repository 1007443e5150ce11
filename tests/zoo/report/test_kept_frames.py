"""The images of a scored drive: its worst moments, and a film."""

from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from rich.console import Console

from zoo.base.errors import InputError
from zoo.drives.drive_film import WorstMoments, badness
from zoo.drives.drive_log import read_drive
from zoo.drives.drive_record import DriveRow
from zoo.evaluate.__main__ import evaluate_or_replay as command
from zoo.film import make_film

FRAME = np.zeros((160, 320, 3), np.uint8)


@given(
    st.lists(st.tuples(st.floats(-4, 4), st.booleans()), min_size=1, max_size=200),
    st.integers(1, 5),
)
def test_the_worst_moment_is_kept_and_no_two_are_near(
    drive: list[tuple[float, bool]], count: int
) -> None:
    rows = [
        DriveRow(time_s=number / 15, cross_track_m=error, intervention=lost)
        for number, (error, lost) in enumerate(drive)
    ]
    moments = WorstMoments(count)
    for row in rows:
        moments(FRAME, row)
    kept = [row for _, row, _ in moments.moments]
    assert 1 <= len(kept) <= count
    assert max(map(badness, kept)) == max(map(badness, rows))
    assert np.diff([row.time_s for row in kept]).min(initial=9.0) >= moments.apart_s
    assert all(rows[number] is row for number, row, _ in moments.moments)


def test_an_intervention_is_worse_than_any_distance() -> None:
    moments = WorstMoments(count=1)
    for number, (error, lost) in enumerate([(3.0, False), (0.5, True), (2.0, False)]):
        moments(FRAME, DriveRow(time_s=10.0 * number, cross_track_m=error, intervention=lost))
    assert [row.intervention for _, row, _ in moments.moments] == [True]


def test_a_scored_drive_is_filmed_on_request(
    run_folder: Path, tmp_path: Path, console: Console, capsys: pytest.CaptureFixture
) -> None:
    checkpoint = str(run_folder / "checkpoints" / "best.ckpt")
    options = ("laps=0.03", "speed=25", "quality=simple", "workers=1")
    command([checkpoint, *options, "film=true", "film_speed=3", f"out={tmp_path / 'filmed'}"])
    film = tmp_path / "filmed" / "lake-0" / "film.mp4"
    assert f"wrote: {film}" in capsys.readouterr().out.splitlines()
    command([checkpoint, *options, f"out={tmp_path / 'plain'}"])
    filmed, plain = (read_drive(tmp_path / name / "lake-0") for name in ("filmed", "plain"))
    assert filmed.steering.tolist() == plain.steering.tolist()
    assert not (plain.folder / "film.mp4").exists()
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(filmed.folder / "film.mp4"))
    assert frames == -(-len(filmed) // 3)
    assert seconds == pytest.approx(frames / 15, abs=0.1)
    about = next(imageio_ffmpeg.read_frames(str(filmed.folder / "film.mp4")))
    assert about["source_size"] == (640, 320)

    names = [name for name in plain.frame if name]
    assert 1 <= len(names) <= 10
    worst = int(np.abs(plain.cross_track_m).argmax())
    assert plain.intervention.any() or plain.frame[worst]
    for name in names:
        with Image.open(plain.folder / name) as image:
            assert image.size == (320, 160)


def test_ten_moments_are_not_a_film(tmp_path: Path, console: Console) -> None:
    from zoo.drives.drive_log import DriveWriter

    writer = DriveWriter(tmp_path)
    writer.add(DriveRow(i / 15, frame="frames/0.jpg" if i == 5 else "") for i in range(200))
    writer.close()
    with pytest.raises(InputError, match=r"worst moments; .*film=true"):
        make_film(tmp_path, tmp_path / "film.mp4", None, console)


@pytest.mark.parametrize("speed", ["0.5", "101"])
def test_a_wrong_film_speed_is_refused_before_driving(
    speed: str, run_folder: Path, tmp_path: Path
) -> None:
    checkpoint = str(run_folder / "checkpoints" / "best.ckpt")
    with pytest.raises(InputError, match=r"film_speed=.* 1\.\.100"):
        command([checkpoint, "film=true", f"film_speed={speed}", f"out={tmp_path / 'out'}"])
