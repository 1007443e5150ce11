"""The steering filter: off by default; gain, low pass and rate limit by elapsed time."""

import pytest

from zoo.base.command_keys import read_options
from zoo.base.errors import InputError
from zoo.drive.drive_settings import DriveSettings
from zoo.drives.speed_controller import SteeringFilter


def test_it_changes_nothing_by_default() -> None:
    steer = SteeringFilter()
    assert [steer(value, now) for now, value in enumerate((0.1, -0.7, 1.0))] == [0.1, -0.7, 1.0]


def test_steering_is_clamped() -> None:
    assert SteeringFilter(gain=3)(0.5, 0) == 1
    assert SteeringFilter()(-1.5, 0) == -1


@pytest.mark.parametrize("hz", [15, 120])
def test_the_rate_limit_goes_by_the_clock(hz: int) -> None:
    steer = SteeringFilter(rate_per_s=0.5)
    steer(0.0, 0)
    assert [steer(1.0, (n + 1) / hz) for n in range(hz)][-1] == pytest.approx(0.5)


@pytest.mark.parametrize("hz", [15, 120])
def test_the_low_pass_goes_by_the_clock(hz: int) -> None:
    steer = SteeringFilter(low_pass_s=1.0)
    steer(0.0, 0)
    assert [steer(1.0, (n + 1) / hz) for n in range(hz)][-1] == pytest.approx(0.632, abs=1e-3)


def test_after_a_reset_the_first_steering_counts_in_full() -> None:
    steer = SteeringFilter(low_pass_s=1.0, rate_per_s=0.1)
    steer(0.0, 0)
    steer.reset()
    assert steer(0.8, 0.01) == 0.8


@pytest.mark.parametrize("setting", ["gain=0", "rate_per_s=-1", "low_pass_s=x"])
def test_a_value_that_cannot_be_is_named(setting: str) -> None:
    with pytest.raises(InputError, match=f"steering.{setting}: must be"):
        read_options(DriveSettings, [f"steering.{setting}"])
