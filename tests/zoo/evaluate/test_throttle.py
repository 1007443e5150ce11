"""`throttle=network`: a policy drives at the speed that its own throttle comes to."""

import numpy as np
import pytest

from simulator.expert import Expert
from simulator.world import open_world
from tests.zoo.commands import only_line, run
from zoo.base.errors import InputError
from zoo.evaluate.many_drives import Setup, check_throttle, drive_setup, expert_steering_per_s


def speeds(setup: Setup, throttle: float | None) -> np.ndarray:
    """Return the speeds in mph of a drive that steers like the expert."""
    world = open_world("lake", renderer="none")
    expert = Expert(world.track)
    drive = drive_setup(lambda *_: (expert(world)[0], throttle), world, setup)
    return np.array([row.speed_mph for row in drive.rows])


def test_it_starts_from_a_standstill_and_goes_as_fast_as_its_throttle() -> None:
    own = Setup("lake", 1, laps=0.3, speed_mph=15, throttle="network")
    slow, fast = speeds(own, 0.1), speeds(own, 0.2)
    assert slow[0] == fast[0] == 0
    assert 5 < slow[-1] < fast[-1]
    assert (np.diff(slow[:60]) > 0).all()


def test_otherwise_its_throttle_is_not_asked_for() -> None:
    held = Setup("lake", 1, laps=0.2, speed_mph=15)
    assert speeds(held, 1.0) == pytest.approx(speeds(held, None))
    assert speeds(held, 1.0).mean() == pytest.approx(15, abs=0.5)


def test_a_network_that_gives_none_is_refused() -> None:
    with pytest.raises(InputError, match=r"throttle=network: .*no throttle"):
        check_throttle(lambda frame, mph: (0.0, None), "network")
    check_throttle(lambda frame, mph: (0.0, 0.5), "network")
    check_throttle(lambda frame, mph: (0.0, None), "hold")


def test_the_expert_beside_it_drives_with_its_own_throttle_too() -> None:
    per_s = [expert_steering_per_s(Setup("lake", throttle=one)) for one in ("hold", "network")]
    assert per_s[0] < per_s[1], "it is faster, and so in more bends a second"


def test_it_is_said_in_one_line(run_folder, tmp_path) -> None:
    checkpoint = str(run_folder / "checkpoints" / "best.ckpt")
    line = only_line(run(tmp_path, checkpoint, "throttle=network", module="zoo.evaluate"))
    assert "no throttle; train model=nvidia_speed" in line
    assert list(tmp_path.iterdir()) == []
