"""Keys of `drivezoo drive` and the choices of `speed`."""

import pytest

from zoo.base.errors import InputError
from zoo.base.key_values import constructed, read_options
from zoo.checkpoints.policy_base import Command
from zoo.driving.speed_controller import PI
from zoo.server.drive_settings import CONTROLLERS, DriveSettings, check_settings


@pytest.mark.parametrize("choice", CONTROLLERS)
def test_every_way_to_choose_the_throttle_can_be_built(choice: str) -> None:
    speed = read_options(DriveSettings, [f"speed={choice}"]).speed
    speed.reset()
    assert -1 <= speed.pedal(Command(0.0, 0.5), 9.0, 0.0) <= 1


def test_the_defaults_are_the_courses_controller_on_loopback() -> None:
    settings = read_options(DriveSettings, [])
    assert isinstance(settings.speed, PI)
    assert (settings.speed.set_mph, settings.speed.kp, settings.speed.ki) == (9, 0.1, 0.002)
    assert (settings.host, settings.port, settings.record) == ("127.0.0.1", 4567, None)
    assert settings.steering(0.3, 0.0) == 0.3


def test_keys_of_a_choice_can_stand_before_it() -> None:
    settings = read_options(DriveSettings, ["speed.throttle=0.4", "speed=constant"])
    assert settings.speed.throttle(Command(0.0), 0.0, 0.0) == 0.4


@pytest.mark.parametrize("typed", ["speed=15", "speed.set_mph=15"])
def test_a_number_for_the_speed_is_the_speed_to_hold(typed: str) -> None:
    assert read_options(DriveSettings, [typed]).speed.set_mph == 15
    assert read_options(
        DriveSettings, ["speed=bends", typed.replace("speed=", "speed.set_mph=")]
    ).speed.bend_mph


def test_a_track_that_does_not_exist_is_refused_before_anything_starts() -> None:
    with pytest.raises(InputError, match=r"sim=laek: .*did you mean lake"):
        check_settings(DriveSettings(**constructed(DriveSettings, {"sim": "laek"})))
    check_settings(read_options(DriveSettings, ["sim=lake"]))
