"""What every world promises, over all implementations, one of another package among them."""

import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datamodules.recording_format import read_recordings
from tests.contracts.outside_package import installed, manual_example
from tests.recordings import write_recording
from tests.zoo.command_runs import ROOT, run_words
from zoo.base.errors import InputError
from zoo.checkpoints.policy_base import as_policy
from zoo.driving.drive_loop import drive
from zoo.driving.open_world import WORLDS, open_world
from zoo.driving.replay_world import ReplayWorld
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.driving.world import State, World

SCENARIOS = {
    "embedded": Scenario("lake", laps=0.02, quality="simple"),
    "replay": Scenario("recording", world="replay"),
    "outside": Scenario(world="straight"),
}

OTHER_VALUES = {
    "direction": "backward",
    "weather": "{fog: 0.4}",
    "delay_s": 0.5,
    "quality": "fast",
    "offset": 0.5,
    "heading": 2.0,
    "start": 3.0,
    "laps": 2.0,
    "frame_rate": 7.0,
    "speed": 9.0,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Install a package outside the checkout; write a recording beside it."""
    folder, here = tmp_path_factory.mktemp("outside"), tmp_path_factory.mktemp("here")
    write_recording(here / "recording", rows=190)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(here)
        with installed(folder, manual_example("my_world.py"), "drivezoo.worlds", WORLDS):
            yield here


@pytest.fixture(params=SCENARIOS)
def opened(request: pytest.FixtureRequest, folder: Path) -> Iterator[tuple[World, Scenario]]:
    scenario = SCENARIOS[request.param]
    world = open_world(scenario)
    yield world, scenario
    world.close()


def test_a_world_is_reset_stepped_and_put_back(opened: tuple[World, Scenario]) -> None:
    world, scenario = opened
    state = world.reset(scenario)
    assert isinstance(state, State)
    assert state.time_s == 0
    assert not state.done
    frame = world.frame()
    assert (frame.ndim, frame.shape[2], frame.dtype) == (3, 3, np.uint8)
    later = world.step(0.1, 0.2)
    assert later.time_s > 0
    back = world.put_back(9.0)
    assert back.time_s >= later.time_s
    assert back.cross_track_m is None or abs(back.cross_track_m) < 0.6
    assert world.reset(scenario).time_s == 0


def test_a_drive_ends_and_is_the_same_twice(opened: tuple[World, Scenario]) -> None:
    world, scenario = opened
    policy = as_policy(lambda frame, mph: (float(frame.mean()) / 255 - 0.4, None))
    drives = [drive(policy, world, scenario, first_only=True) for _ in range(2)]
    assert len(drives[0]) > 1
    assert drives[0].track
    for column in ("time_s", "steering", "speed_mph", "cross_track_m", "intervention"):
        first, second = (getattr(driven, column) for driven in drives)
        np.testing.assert_array_equal(first, second)


def test_a_key_that_a_world_ignores_is_refused(opened: tuple[World, Scenario]) -> None:
    world, scenario = opened
    others = [replace(scenario, **{key: OTHER_VALUES[key]}) for key in world.ignores]
    for key, other in zip(world.ignores, others, strict=True):
        with pytest.raises(InputError, match=f"^{key}: changes nothing in world=.*; drop one$"):
            other.check_ignored(world.ignores)
    for other in others[:1]:
        with pytest.raises(InputError, match="changes nothing in world="):
            open_world(other)


def test_a_world_of_another_package_is_named_by_its_entry_point(folder: Path) -> None:
    (straight,) = all_drives(as_policy(lambda frame, mph: (0.3, None)), [SCENARIOS["outside"]])
    assert straight.intervention.any(), "it leaves the straight road"
    with pytest.raises(InputError, match=r"world=strait: no such world; did you mean straight"):
        open_world(Scenario(world="strait"))


SCRIPT = """
from zoo.driving.open_world import open_world
from zoo.driving.scenario import Scenario

scenario = Scenario(world="straight")
print(open_world(scenario).reset(scenario).width_m)
"""


def test_a_world_of_a_package_works_in_a_script_beside_its_source(tmp_path: Path) -> None:
    project, site = tmp_path / "project", tmp_path / "site"
    # As `pip install -e .` leaves them: what is installed, and a folder that only builds need.
    for about in (project / "my_world.egg-info", site / "my_world-1.dist-info"):
        about.mkdir(parents=True)
        text = "Metadata-Version: 2.1\nName: my_world\nVersion: 1\n"
        (about / "METADATA").write_text(text)
        (about / "PKG-INFO").write_text(text)
        (about / "entry_points.txt").write_text("[drivezoo.worlds]\nmy_world = my_world\n")
    (project / "my_world.py").write_text(manual_example("my_world.py"))
    (project / "script.py").write_text(SCRIPT)
    path = os.pathsep.join((str(site), str(ROOT)))
    result = run_words(project, sys.executable, "script.py", PYTHONPATH=path)
    assert result.stdout == "6.0\n", result.stderr


def test_a_recording_that_is_open_is_a_world_too(folder: Path) -> None:
    recording = read_recordings(str(folder / "recording"))
    straight = as_policy(lambda frame, mph: (0.0, None))
    (replayed,) = all_drives(straight, [Scenario(margin=0.5)], world=ReplayWorld(recording))
    (by_name,) = all_drives(straight, [Scenario("recording", world="replay", margin=0.5)])
    np.testing.assert_array_equal(replayed.cross_track_m, by_name.cross_track_m)
