"""Search of the input of small networks, whose input is known."""

from pathlib import Path

import pytest

from datamodules.recording import Recording, read_recordings
from datamodules.view import View
from tests.recordings import recording_in_memory, write_recording
from tests.zoo.keras_networks import write_steering_h5
from zoo.base.errors import InputError
from zoo.input_search.combinations import SCALES, KnownInput, choose_rows, read_trial_frames
from zoo.input_search.judgement import judge
from zoo.input_search.keras_import import network_maker
from zoo.input_search.trials import try_inputs
from zoo.keras.keras_file import read_keras
from zoo.keras.keras_layers import convert

SIZE = (12, 40)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("search") / "lake"
    return read_recordings(str(write_recording(folder, rows=200, seed=3).folder))


@pytest.mark.parametrize(
    ("colour", "crop", "channels"),
    [("yuv_old", (60, 25), 3), ("hsv", (70, 25), 3), ("hsv_s", (70, 25), 1)],
)
def test_colour_and_crop_of_the_training_are_found(
    colour: str, crop: tuple[int, int], channels: int, recording: Recording, tmp_path: Path
) -> None:
    view = View(crop, colour, SIZE)
    converted = convert(read_keras(write_steering_h5(tmp_path / "m.h5", recording, view)))
    known = KnownInput(shape=(*SIZE, channels), scale=SCALES[0])
    shares: list[float] = []
    frames = read_trial_frames(recording, 120)
    trials = try_inputs(network_maker(converted), known, frames, shares.append)
    found = judge(trials)
    assert found.best.combination.view == view
    assert found.doubts == ()
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_an_unknown_scale_is_found(recording: Recording, tmp_path: Path) -> None:
    view = View((60, 25), "rgb", SIZE)
    converted = convert(read_keras(write_steering_h5(tmp_path / "m.h5", recording, view)))
    assert converted.scale is None
    known = KnownInput(shape=(*SIZE, 3), colour="rgb", crop=(60, 25))
    trials = try_inputs(network_maker(converted), known, read_trial_frames(recording, 120))
    assert judge(trials).best.combination.scale in ((127.5, 1.0), (128.0, 1.0))


def test_frames_lie_in_bends_all_over_the_recording() -> None:
    steering = [0.0, 0.3, -0.3] * 100
    rows = choose_rows(recording_in_memory(steering), 80)
    assert len(rows) == 80
    assert (rows % 3 > 0).all()
    assert (rows[0], rows[-1]) == (1, 299)


def test_a_recording_without_bends_is_refused() -> None:
    with pytest.raises(InputError, match=r"/lake/0: only 0 of 300 rows .* bends"):
        choose_rows(recording_in_memory([0.01] * 300), 80)


def test_a_broken_image_names_its_row(tmp_path: Path) -> None:
    written = write_recording(tmp_path / "lake", rows=150)
    recording = read_recordings(str(written.folder))
    row = choose_rows(recording, 60)[5]
    written.image(row, "left").write_bytes(b"no image")
    with pytest.raises(InputError, match=rf"driving_log.csv, row {row + 1}: .*left_"):
        read_trial_frames(recording, 60)
