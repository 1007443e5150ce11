"""Rigs in files."""

from pathlib import Path

import pytest

from zoo.base.errors import InputError
from zoo.base.rig import RIGS, UDACITY
from zoo.base.rig_file import find_rig, named_rig, read_rig, write_rig
from zoo.commands.new import write_part

TEXT = """\
name: my car
camera: {size: [640, 480], vertical_fov_deg: 40, up_m: 1.3, pitch_down_deg: 3}
wheelbase_m: 2.85
steering_deg: 31.7
guesses: [pitch]
"""


def test_a_rig_is_read(tmp_path: Path) -> None:
    assert find_rig(tmp_path) is None
    (tmp_path / "rig.yaml").write_text(TEXT)
    rig = find_rig(tmp_path)
    assert (rig.name, rig.wheelbase_m, rig.steering_deg) == ("my car", 2.85, 31.7)
    assert rig.cameras["center"].size == (640, 480)
    assert rig.cameras["center"].focal_px == pytest.approx(659.4, abs=0.1)
    assert rig.guesses == ("pitch",)


def test_side_cameras_stand_to_the_left_and_right_of_the_centre_one(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(TEXT.replace("1.3,", "1.3, right_m: 0.1,") + "side_m: 0.5\n")
    cameras = read_rig(tmp_path / "rig.yaml").cameras
    places = {name: (camera.right_m, camera.up_m) for name, camera in cameras.items()}
    assert places == {"center": (0.1, 1.3), "left": (-0.4, 1.3), "right": (0.6, 1.3)}


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("[640, 480]", "[640, 0]", "camera.size.1"),
        ("vertical_fov_deg: 40", "fov: 40", "camera.vertical_fov_deg"),
        ("2.85", "-1", "wheelbase_m"),
        ("{size", "{own_car: [[[0, 9], [9, -1], [9, 9]]], size", "camera.own_car.0.1.1"),
        ("31.7", ".nan", "steering_deg"),
        ("name", "cars", "cars"),
    ],
)
def test_an_impossible_number_is_named(old: str, new: str, key: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(InputError, match=rf"rig\.yaml: {key}: .*; correct it"):
        read_rig(path)


def test_a_new_rig_names_each_null(here: Path) -> None:
    write_part("rig", "my_car", here)
    nulls = "camera.size, camera.vertical_fov_deg, camera.up_m, wheelbase_m, steering_deg"
    with pytest.raises(InputError, match=rf"my_car\.yaml: .*: {nulls}; fill them in"):
        read_rig(here / "my_car.yaml")


def test_a_rig_has_a_name_or_a_file(here: Path) -> None:
    assert named_rig("donkey_sim").steering_deg == 16
    assert named_rig("udacity") == UDACITY
    (here / "mine.yaml").write_text(TEXT)
    assert named_rig("mine.yaml").name == "my car"
    with pytest.raises(InputError, match=r"^rig=donkey_sin: .*donkey_sim\?.*drivezoo new rig"):
        named_rig("donkey_sin")


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_that_is_written_drives_the_same(name: str, tmp_path: Path) -> None:
    write_rig(tmp_path, RIGS[name])
    again = read_rig(tmp_path / "rig.yaml")
    rig = RIGS[name]
    assert again.steering_deg == rig.steering_deg
    assert again.wheelbase_m == pytest.approx(rig.wheelbase_m)
    lens, original = again.cameras["center"], rig.cameras["center"]
    assert lens.ahead_m + again.rear_axle_m == pytest.approx(original.ahead_m + rig.rear_axle_m)


BONNET = "own_car: [[[0, 480], [320, 400.5], [640, 480]]]"


def test_a_written_rig_is_read_again(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(TEXT.replace("size", f"{BONNET}, size") + "side_m: 0.5\n")
    rig = read_rig(tmp_path / "rig.yaml")
    assert rig.cameras["center"].own_car == (((0, 480), (320, 400.5), (640, 480)),)
    assert rig.cameras["left"].own_car == ()
    write_rig(tmp_path, rig)
    assert read_rig(tmp_path / "rig.yaml") == rig
