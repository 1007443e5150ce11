"""Labels in one unit for cars of different rigs."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from datamodules.augment import Shift
from datamodules.augmented_batch import Augment
from datamodules.data_settings import DataSettings
from datamodules.format_options import ReadOptions
from datamodules.formats.labels import _with_full_lock
from datamodules.recording import Recording
from datamodules.samples import make_samples
from datamodules.steering_label import curvature_label, in_label
from datamodules.steering_unit import SteeringUnit
from tests import foreign_recordings as foreign
from tests.contracts.test_recordings import COLUMNS
from tests.recordings import recording_in_memory
from zoo.base.errors import UsageError
from zoo.base.rig import STEERING, UDACITY, Camera, single_camera_rig

LONG = single_camera_rig("long", Camera(0, 1.5, 0), wheelbase_m=3.0, steering_deg=60.0)
LONG.cameras.update({side: UDACITY.cameras[side] for side in ("left", "right")})
RIG_FILE = """name: long
camera: {size: [320, 160], vertical_fov_deg: 60, up_m: 1.5}
wheelbase_m: 3.0
steering_deg: 60
guesses: [wheelbase_m]
"""
CURVATURES = np.linspace(-0.1, 0.1, 21)


@pytest.fixture
def two_cars() -> Recording:
    """Return the same bends, driven by Udacity's car and by one that is longer."""
    steering = np.concatenate([rig.steering_of(CURVATURES) for rig in (UDACITY, LONG)])
    recording = recording_in_memory(steering, sizes=(len(CURVATURES),) * 2)
    return replace(recording, rig=None, rigs=(UDACITY, LONG))


def test_the_same_bend_has_the_same_label_for_each_car(two_cars: Recording) -> None:
    label = curvature_label(two_cars)
    first, second = np.split(in_label(two_cars, two_cars.steering, label), 2)

    np.testing.assert_allclose(first * label.curvature_per_m, CURVATURES, atol=1e-12)
    np.testing.assert_allclose(second, first, atol=1e-12)
    assert not np.allclose(*np.split(two_cars.steering, 2), atol=0.05)


def test_each_car_steers_its_own_way_for_a_label(two_cars: Recording) -> None:
    label = curvature_label(two_cars)
    labels = in_label(two_cars, two_cars.steering, label)
    for rig, values, steering in zip(
        (UDACITY, LONG), np.split(labels, 2), np.split(two_cars.steering, 2), strict=True
    ):
        np.testing.assert_allclose(label.steering(values, rig), steering, atol=1e-12)


def test_a_sharp_driven_bend_widens_the_range() -> None:
    sharp = replace(recording_in_memory([0.0, 1.0]), rig=replace(UDACITY, steering_deg=50.0))
    label = curvature_label(sharp)
    assert label.curvature_per_m > 2 * UDACITY.curvature(1.0)
    assert in_label(sharp, sharp.steering, label).tolist() == [0.0, 1.0]


def test_a_side_camera_adds_the_curvature_of_its_offset_for_its_car(two_cars: Recording) -> None:
    label = curvature_label(two_cars)
    labelled = replace(two_cars, steering=in_label(two_cars, two_cars.steering, label))
    samples = make_samples(labelled, np.arange(len(two_cars)), ["left"], 0.1, label=label)
    for number, rig in enumerate((UDACITY, LONG)):
        mask = two_cars.recording == number
        added = (samples.steering - labelled.steering)[mask] * label.curvature_per_m
        np.testing.assert_allclose(added, rig.curvature(0.1), rtol=1e-4)


def test_recovery_adds_one_curvature_for_all_cars(two_cars: Recording) -> None:
    label = curvature_label(two_cars)
    labelled = replace(two_cars, steering=in_label(two_cars, two_cars.steering, label))
    samples = make_samples(labelled, np.arange(len(two_cars)), ["left"], recover_s=2.0, label=label)
    assert np.ptp(samples.steering - labelled.steering) < 1e-6
    assert samples.steering[0] > labelled.steering[0]


def test_a_shifted_image_adds_the_curvature_of_its_steering(two_cars: Recording) -> None:
    images, labels = np.zeros((1, 16, 32, 3), np.uint8), np.array([0.2], np.float32)
    changed = {
        label: Augment([Shift(p=1.0)], "rgb", label)(images, labels, seed=3)[1] - labels
        for label in (STEERING, curvature_label(two_cars))
    }
    steering, curvature = changed.values()
    assert steering != 0
    full = curvature_label(two_cars).curvature_per_m
    expected = UDACITY.curvature(UDACITY.steering_of(labels * full) + steering) - labels * full
    np.testing.assert_allclose(curvature * full, expected, rtol=1e-4)


def test_an_unknown_car_is_refused_with_the_file_to_write() -> None:
    tub = replace(recording_in_memory(np.zeros(9)), rig=None)
    with pytest.raises(UsageError, match=r"/lake/0: .*rig.yaml.*data.rig="):
        curvature_label(tub)


def test_the_users_full_lock_is_that_of_the_rig() -> None:
    stated = SteeringUnit("deg", full=540.0)
    wider = _with_full_lock(LONG, stated, SteeringUnit("deg", full=270.0))
    assert wider.steering_deg == LONG.steering_deg / 2
    assert _with_full_lock(LONG, stated, SteeringUnit("servo", full=45.0)) is None


def test_formats_with_keys_and_weights_of_their_own_train_on_one_unit(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """A road car, and a toy car that writes a servo's numbers in another format."""
    road = foreign.challenge2_test(tmp_path / "road")
    toy = foreign.table(tmp_path / "toy", 90 + 45 * foreign.STEERING)
    (toy / "rig.yaml").write_text(RIG_FILE.replace("long", "toy"))
    servo = {"steering": {"unit": "servo", "zero": 90, "full": 45}, **COLUMNS}
    settings = {"cache": None, "colour": "gray", "size": (16, 32), "block_s": 0.5, "gap_s": 0.1}
    settings |= {"batch_size": 16, "samples_per_epoch": 4000, "straight_cap": None}
    keys = {"label": "curvature", "each": {2: servo}, "weights": [1, 3]}
    data = DataSettings([str(road), str(toy)], **keys, **settings).load(Console(soft_wrap=True))

    driven = np.split(data.labelled.steering * data.label.curvature_per_m, 2)
    for curvature, wheels_deg, wheelbase_m in zip(driven, (31.745, 60), (2.85, 3), strict=True):
        wheels = np.radians(wheels_deg * foreign.STEERING)
        np.testing.assert_allclose(curvature, np.tan(wheels) / wheelbase_m, atol=1e-6)
    drawn = data.samples.row[np.concatenate([key.samples for key in data.sampler()])]
    share = data.recording.recording[data.samples.row].mean()
    expected = 3 * share / (3 * share + 1 - share)
    assert data.recording.recording[drawn].mean() == pytest.approx(expected, abs=0.01)
    np.testing.assert_allclose(data.recording.steering, [*foreign.STEERING] * 2)
    lines = capsys.readouterr().out
    assert f"a radius of 1.7 m in {toy}, 4.6 m in {road}; data.label=curvature" in lines
    assert re.search(r"GUESSED: camera, full(.|\n)*GUESSED: wheelbase_m", lines)
    assert f"{data.label.curvature_per_m:.4f} 1/m" in lines


@pytest.mark.parametrize(
    ("each", "words"),
    [
        ("{3: {format: table}}", r"each: 3: data.root names 2"),
        ({1: {"cache": "x"}}, r"each: 1: .*cache.*format, columns, steering"),
        ({"1": {"speed_unit": "knots"}}, r"each: 1: speed_unit.*knots"),
        ({1: "table"}, r"each: 1: table"),
        (3, r"each=3: must be"),
    ],
)
def test_a_key_of_no_recording_is_refused(each: object, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        ReadOptions(each=each).of_each(2)
