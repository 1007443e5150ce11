"""Films of recordings, drives and folders of images, checked by decoding them."""

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np
import pytest

from tests.datamodules.exchange.test_tub import record, write_tub
from tests.recordings import Written, write_recording
from tests.zoo.command_runs import only_line, run_here, succeed
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError
from zoo.base.rig import UDACITY
from zoo.checkpoints.policy_base import as_policy
from zoo.commands.film import film as film_command
from zoo.commands.film import read_shots, real_fps
from zoo.driving.drive_film import GREEN, RED, Overlay, draw_overlay
from zoo.driving.drive_log import DriveWriter, write_drive
from zoo.driving.drive_record import PERSON, REPLAY, Drive, DriveRow
from zoo.driving.open_world import open_world
from zoo.driving.pilot_film import COLOURS, GRAPH_HALF, GRAPH_TOP, STRIP, Pilots
from zoo.driving.scenario import Scenario
from zoo.scoring.track_scores import KeptDrive

GREY = np.full((160, 320, 3), 90, np.uint8)


def decode(path: Path) -> tuple[dict, np.ndarray]:
    """Return a film's metadata (`fps`, `codec`, ...) and its frames, uint8 [N, H, W, 3]."""
    reader = imageio_ffmpeg.read_frames(str(path))
    meta = next(reader)
    width, height = meta["size"]
    frames = np.array([np.frombuffer(frame, np.uint8) for frame in reader])
    return meta, frames.reshape(-1, height, width, 3)


def film(cwd: Path, *arguments: object) -> subprocess.CompletedProcess:
    return run_here(cwd, *map(str, arguments), module="zoo.commands.film")


def test_a_recording_becomes_h264_in_real_time(recorded: Written, tmp_path: Path) -> None:
    printed = succeed(film(tmp_path, recorded.folder, "out=films/lake.mp4"))

    assert printed.splitlines()[-1] == "wrote: films/lake.mp4"
    meta, frames = decode(tmp_path / "films" / "lake.mp4")
    assert meta["codec"].startswith("h264")
    assert "yuv420p" in meta["pix_fmt"]
    assert frames.shape == (120, 320, 640, 3)
    assert meta["fps"] == pytest.approx(15, abs=0.2)


def test_images_are_filmed_in_the_order_of_time(recorded: Written, tmp_path: Path) -> None:
    folder = tmp_path / "a=[run] 1"
    folder.mkdir()
    for row in (7, 3, 5):
        shutil.copy(recorded.image(row), folder / f"{recorded.stems[row]}.jpg")

    shots = read_shots(folder, [])
    succeed(film(tmp_path, folder, "fps=48"))

    assert [shot.path.stem for shot in shots] == [recorded.stems[row] for row in (3, 5, 7)]
    assert shots[0].state == Overlay()
    assert real_fps(shots) == pytest.approx(7.5, abs=0.1)
    assert real_fps(sorted(shots * 2, key=lambda shot: shot.time_s)) == pytest.approx(19, abs=0.5)
    meta, frames = decode(tmp_path / "a=[run] 1.mp4")
    assert meta["fps"] == 48
    assert len(frames) == 3


def test_a_drive_shows_autonomy_and_cross_track_error(recorded: Written, tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    shutil.copytree(recorded.folder / "IMG", folder / "IMG")
    writer = DriveWriter(folder)
    names = [f"IMG/{recorded.image(row).name}" for row in range(120)]
    # Each image twice, as the original simulator sends it; a person intervenes after 4 s.
    figures = {"steering": 0.1, "throttle": 0.2, "speed_mph": 9.0, "spread": 0.05}
    for number in range(240):
        driver = PERSON if 120 <= number < 130 else "policy"
        row = DriveRow(number / 30, frame=names[number // 2], driver=driver, **figures)
        writer.add([replace(row, cross_track_m=-0.5, intervention=number == 120)])
    writer.close()

    shots = read_shots(folder, [])

    assert len(shots) == 120
    assert shots[59].state.autonomy == 1
    assert shots[60].state.note == "a person drives"
    assert shots[-1].state.autonomy == pytest.approx(1 - 6 / shots[-1].time_s, abs=0.01)
    assert (shots[-1].state.cte_m, shots[-1].state.spread) == (-0.5, 0.05)
    assert len(decode(film_command(folder))[1]) == 120


def test_unreadable_images_are_skipped_odd_names_kept(recorded: Written, tmp_path: Path) -> None:
    folder = tmp_path / "[brightness] [red] :car:"
    folder.mkdir()
    for row in range(4):
        shutil.copy(recorded.image(row), folder)
    (folder / recorded.image(1).name).write_bytes(b"")

    out = succeed(film(tmp_path, folder))

    assert out.splitlines()[-1] == f"wrote: {folder.name}.mp4"
    assert f"{folder / recorded.image(1).name}: " in out
    assert re.search(r"\b1 \w+ (left out|skipped)", out)
    assert "empty" in out
    assert len(decode(folder.with_name(f"{folder.name}.mp4"))[1]) == 3


def test_rows_without_their_image_are_left_out_and_counted(tmp_path: Path) -> None:
    written = write_recording(tmp_path / "log", rows=6)
    written.image(2).unlink()
    written.image(4).write_bytes(b"")
    out = succeed(film(tmp_path, written.folder))
    assert re.search(r"^2 images left out: .*driving_log\.csv, row 3: no image", out, re.MULTILINE)
    assert "\n4 frames at " in out


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([], "usage: drivezoo film FOLDER"),
        (["nowhere"], "nowhere: "),
        (["empty"], "driving_log.csv"),
        (["lake", "fps=0"], "fps=0: "),
        (["lake", "out=film.avi"], ".mp4"),
    ],
)
def test_wrong_arguments_are_named_with_a_remedy(
    arguments: list[str], text: str, recorded: Written, here: Path
) -> None:
    (here / "empty").mkdir()
    (here / "lake").symlink_to(recorded.folder)
    with pytest.raises(InputError, match=re.escape(text)):
        film_command.main(arguments)


@pytest.mark.parametrize("small_disk", ["4k"], indirect=True)
def test_a_full_disk_gets_one_line_and_leaves_no_film(recorded: Written, small_disk: Path) -> None:
    (small_disk / "mine").write_bytes(bytes(4096))
    line = only_line(film(small_disk, recorded.folder, "out=lake.mp4"))
    for words in ("lake.mp4", "full", "out="):
        assert words in line
    assert [path.name for path in small_disk.iterdir()] == ["mine"]


@pytest.mark.parametrize("small_disk", ["4k"], indirect=True)
def test_a_full_disk_during_a_scored_drive_gets_one_line(small_disk: Path) -> None:
    (small_disk / "mine").write_bytes(bytes(4096))
    keep = KeptDrive(small_disk, film_speed=1).__enter__()
    keep.begin(open_world(Scenario("lake"), "none"))
    keep.show(GREY, DriveRow(0.0, speed_mph=9.0, cross_track_m=0.0))
    with pytest.raises(InputError, match=r"film\.mp4.*full"):
        keep.__exit__(None, None, None)
    assert not list(small_disk.glob("*.mp4"))


def test_a_film_below_outputs_is_replaced_unless_it_is_named(tmp_path: Path) -> None:
    write_recording(tmp_path / "outputs" / "lake", rows=3)
    for _ in range(2):
        assert film(tmp_path, "outputs/lake").returncode == 0
    line = only_line(film(tmp_path, "outputs/lake", "out=outputs/lake.mp4"))
    assert "out=outputs/lake.mp4: exists" in line


def test_moments_are_no_film_but_the_recording_beside_them(
    recorded: Written, tmp_path: Path
) -> None:
    writer = DriveWriter(tmp_path)
    for row in range(120):
        writer.add([DriveRow(row / 15, frame="frames/60.jpg" if row == 60 else "")])
    writer.close()
    with pytest.raises(InputError, match="only its worst moments"):
        read_shots(tmp_path, [])
    shutil.copytree(recorded.folder, tmp_path, dirs_exist_ok=True)  # as evaluate record=true
    assert len(read_shots(tmp_path, [])) == 120


def test_an_autonomy_that_is_not_measured_is_not_shown(recorded: Written, tmp_path: Path) -> None:
    writer = DriveWriter(tmp_path)
    for row in range(10):
        shutil.copy(recorded.image(row), tmp_path / f"{row}.jpg")
        writer.add([DriveRow(row / 10, frame=f"{row}.jpg", intervention=row == 5)])
    writer.close()
    shots = read_shots(tmp_path, [])
    assert {shot.state.autonomy for shot in shots[:5]} == {None}
    assert shots[9].state.autonomy == 0, "a takeover shows that a person watches"


def test_a_simulator_that_connects_again_is_filmed_after_its_first_frames(tmp_path: Path) -> None:
    writer = DriveWriter(tmp_path)
    for client, time_s in ((1, 5.0), (1, 5.1), (2, 1.0), (3, 1.0), (2, 1.1)):
        name = "" if client == 3 else f"{client}-{time_s}.jpg"  # only one is recorded at a time
        writer.add([DriveRow(time_s, client, frame=name, intervention=time_s == 5.1)])
    writer.close()
    filmed = [(shot.path.name[0], shot.state.note) for shot in read_shots(tmp_path, [])]
    assert filmed == [("1", None), ("1", "intervention"), ("2", None), ("2", None)]


def test_the_overlay_draws_only_known_values() -> None:
    bare = draw_overlay(GREY, Overlay(None, float("nan"), None))
    assert bare.shape == (320, 640, 3)
    assert bare.dtype == np.uint8
    assert (bare == 90).all()
    road = draw_overlay(np.full((480, 640, 3), 90, np.uint8), Overlay())
    assert road.shape == (480, 640, 3), "a frame keeps its shape"
    whole = draw_overlay(GREY, Overlay(-0.2, 0.5, 9.0, 0.97, 0.3, "nvidia"))
    assert (whole[12:61, 467:627] != 90).any(), "autonomy and distance are at the top right"
    assert (draw_overlay(GREY, Overlay(0.0, 0.0, 9.0))[12:61] == 90).all()


def test_the_time_never_has_sixty_seconds() -> None:
    late, minute = (draw_overlay(GREY, Overlay(time_s=value)) for value in (59.96, 60.0))
    assert np.array_equal(late, minute)


def test_a_spread_is_drawn_as_a_band_around_the_steering() -> None:
    sure = draw_overlay(GREY, Overlay(0.4, None, None))
    assert np.array_equal(draw_overlay(GREY, Overlay(0.4, None, None, spread=float("nan"))), sure)
    doubting = draw_overlay(GREY, Overlay(0.4, None, None, spread=0.1))
    columns = np.flatnonzero((doubting != sure)[285:287].any((0, 2)))
    # 100 pixels right of the middle is full lock; the band is 1.96 spreads wide on each side.
    assert (columns.min(), columns.max()) == (320 + round(100 * 0.204), 320 + round(100 * 0.596))
    assert np.array_equal(doubting[:200], sure[:200])


def test_steering_turns_the_wheel_and_pedals_have_their_colours() -> None:
    left, right = (draw_overlay(GREY, Overlay(value, None, None)) for value in (-0.3, 0.3))
    assert not np.array_equal(left[253:, :80], right[253:, :80])
    throttle, brake = (draw_overlay(GREY, Overlay(None, value, None)) for value in (0.8, -0.8))
    for image, colour, other in ((throttle, GREEN, RED), (brake, RED, GREEN)):
        assert (image[293:] == colour).all(2).sum() > 130
        assert not (image[293:] == other).all(2).any()


def test_a_replay_shows_the_recorded_steering(tmp_path: Path) -> None:
    row = DriveRow(0.0, steering=-0.2, cross_track_m=0.1, expert_steering=0.3)
    rows = [
        replace(row, time_s=number / 10, frame=f"{number}.jpg", intervention=number == 5)
        for number in range(30)
    ]
    write_drive(tmp_path, Drive.of(rows, source=REPLAY, lane_m=1.0))
    shots = read_shots(tmp_path, [])
    assert {shot.state.recorded for shot in shots} == {0.3}
    noted = [number for number, shot in enumerate(shots) if shot.state.note]
    assert noted == list(range(5, 15)), "for a second"
    shown, alone = (draw_overlay(GREY, Overlay(-0.2, recorded=value)) for value in (0.3, None))
    assert (shown[253:, :80] == GREEN).all(2).any(), "a mark on the wheel"
    assert not (alone == GREEN).all(2).any()


def test_a_recording_of_any_format_is_filmed(tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", [record(index) for index in range(5)])
    shots = read_shots(tub, [])
    assert len(shots) == 5
    assert {shot.state.rig for shot in shots} == {None}, "its car is unknown"
    assert film_command(tub).stat().st_size > 0


def test_the_steering_of_an_unknown_car_is_no_angle() -> None:
    angle, unknown = (draw_overlay(GREY, Overlay(0.4, rig=rig)) for rig in (UDACITY, None))
    assert not np.array_equal(angle, unknown)


def test_pilots_steer_beside_the_recorded_driver(tmp_path: Path) -> None:
    for name, steering in (("a", 0.3), ("b", -0.2)):
        write_constant(tmp_path / f"{name}.ckpt", steering)
    write_recording(tmp_path / "lake", rows=10)
    printed = succeed(film(tmp_path, "lake", "ckpt=a.ckpt,b.ckpt", "out=pilots.mp4"))
    assert "wrote: " in printed
    assert (tmp_path / "pilots.mp4").stat().st_size


def test_steering_is_read_as_in_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written, wheels = write_recording(tmp_path / "lake", rows=3), []
    data = {"root": str(written.folder), "steering": {"right": "negative"}, "on_bad_row": "skip"}
    pilot = write_constant(tmp_path / "a.ckpt", 0.3, data=data)
    monkeypatch.setattr(Pilots, "draw", lambda self, frame: wheels.append(self.steering) or frame)
    film_command(written.folder, ckpt=str(pilot))
    assert [wheel for wheel, _ in wheels[0]] == pytest.approx(-written.steering)
    (written.folder / "driving_log.csv").open("a").write("a.jpg,b.jpg,c.jpg,far,0,0,1\n")
    assert "on_bad_row=skip" in only_line(film(tmp_path, "lake", "out=a.mp4"))
    assert "3 frames" in succeed(film(tmp_path, "lake", "out=a.mp4", "on_bad_row=skip"))
    succeed(run_here(tmp_path, "a.ckpt", "lake", module="zoo.commands.saliency"))


def test_pilots_forget_at_pauses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames = 0

    def drive(frame: np.ndarray, mph: float) -> tuple[float, None]:
        nonlocal frames
        frames += 1
        return 0.0, None

    policy, resets = as_policy(drive), []
    policy.reset = lambda: resets.append(frames)
    monkeypatch.setattr("zoo.checkpoints.checkpoint_policy.load_policy", lambda driver: policy)
    write_constant(tmp_path / "a.ckpt", 0.3)
    log = write_recording(tmp_path / "lake", rows=40).folder / "driving_log.csv"
    lines = log.read_text().splitlines(keepends=True)
    log.write_text("".join(lines[:10] + lines[30:]))  # 1.4 s later
    succeed(film(tmp_path, "lake", "ckpt=a.ckpt", "out=pilots.mp4"))
    assert (policy.rig, resets, frames) == (UDACITY, [0, 10], 20)


def test_the_panel_shows_how_far_each_pilot_is_off() -> None:
    pilots = Pilots(["a", "b"], None, [[0.1, 0.1, -0.4]] * 3)
    image = pilots.draw(np.full((160, 320, 3), 90, np.uint8))
    assert image.shape == (320 + STRIP, 640, 3)
    lines = [np.flatnonzero((image[320:, -11] == colour).all(axis=1)) for colour in COLOURS[:2]]
    middle = GRAPH_TOP + GRAPH_HALF
    assert lines[0].mean() == pytest.approx(middle, abs=1)
    assert lines[1].mean() == pytest.approx(middle - GRAPH_HALF, abs=1)  # further left: above


@pytest.mark.parametrize("words", ["ckpt=a,b,c,d,e", "ckpt=missing.ckpt"])
def test_pilots_that_cannot_be_are_refused(words: str, recorded: Written, tmp_path: Path) -> None:
    result = film(tmp_path, recorded.folder, words, "out=a.mp4")
    assert result.returncode in (1, 2)
    assert not (tmp_path / "a.mp4").exists()


def test_images_have_no_steering_to_compare_with(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "a.jpg"), np.zeros((16, 32, 3), np.uint8))
    write_constant(tmp_path / "a.ckpt", 0.3)
    assert "no steering" in only_line(film(tmp_path, "images", "ckpt=a.ckpt"))
