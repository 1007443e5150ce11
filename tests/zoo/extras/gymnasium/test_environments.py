"""Gymnasium environments as worlds: what a YAML file maps, and a line for each fault."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import imageio_ffmpeg
import numpy as np
import pytest
from gymnasium import spaces
from omegaconf import OmegaConf
from rich.console import Console

from datamodules.recorded_car import other_car
from datamodules.recording_format import read_recordings
from tests.contracts.test_worlds import (  # noqa: F401  the contract, with the fixture below
    test_a_drive_ends_and_is_the_same_twice,
    test_a_key_that_a_world_ignores_is_refused,
    test_a_world_is_reset_stepped_and_put_back,
)
from zoo.base.conf_files import choice_files
from zoo.base.errors import InputError
from zoo.base.parts import name_parts
from zoo.checkpoints.policy_base import as_policy
from zoo.driving.drive_loop import drive
from zoo.driving.drives_table import mean_and_spread
from zoo.driving.metrics import measure
from zoo.driving.open_world import open_world
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.driving.world import World
from zoo.extras.gymnasium.environment_mapping import find_environment
from zoo.scoring.evaluate_options import EvaluateOptions
from zoo.scoring.evaluation import score_driver
from zoo.scoring.track_scores import KeptDrive, how_well

MAPPED = """
env: SmallCar-v0
image: observation.0
speed: {place: env.car.speed, factor: 2}
steering: {component: 1, full: -0.5}
throttle: {component: 0}
brake: {component: 2}
frame_rate: 10
"""
ROAD = """
cross_track: {place: info.side}
width: {place: info.road.width}
interventions: [info.hit]
seconds: 3
"""


class Car:
    speed = 5.0


class SmallCar(gymnasium.Env):
    """A car on a road 4 m wide, which a wall closes after 8 steps; steering is left positive."""

    action_space = spaces.Box(np.float32([0, -0.5, 0]), np.float32([1, 0.5, 1]))
    observation_space = spaces.Tuple([spaces.Box(0, 255, (8, 12, 3), np.uint8)])

    def __init__(self, fault: str | float = "") -> None:
        self.fault, self.car, self.actions = fault, Car(), []

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict]:
        super().reset(seed=seed)
        if self.fault == "reset":
            raise RuntimeError("no\nroad")
        self.steps, self.side = 0, 0.0
        return self._see(), self._info()

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict]:
        self.actions.append(action.tolist())
        self.steps += 1
        self.side -= float(action[1])
        if isinstance(self.fault, float):
            self.car.speed = self.side = self.fault
        hit = self.steps >= 8
        return self._see(), 1.0, hit and self.fault != "endless", False, self._info(hit)

    def _see(self) -> tuple[np.ndarray]:
        rows = 9 if self.fault == "size" and self.steps else 8
        return (np.zeros((rows, 12, 1 if self.fault == "grey" else 3), np.uint8),)

    def _info(self, hit: bool = False) -> dict[str, Any]:
        facts = {"side": self.side, "road": {"width": 4.0}, "lap": self.steps // 4}
        return facts | {"hit": "wall" if hit else "none"}


@pytest.fixture(autouse=True)
def _registered(here: Path) -> Iterator[None]:
    gymnasium.register("SmallCar-v0", SmallCar)
    yield
    del gymnasium.registry["SmallCar-v0"]


def straight(text: str, steering: float = 0.0, **keys: Any) -> Any:
    """Return a drive in the environment that a file maps."""
    Path("small.yaml").write_text(text)
    scenario = Scenario(world="small.yaml", **keys)
    world = open_world(scenario)
    return drive(as_policy(lambda frame, mph: (steering, None)), world, scenario), world


def test_a_file_maps_image_speed_and_action() -> None:
    driven, world = straight(MAPPED, steering=0.4, speed=12)
    first = world.environment.unwrapped.actions[0]
    assert first == pytest.approx([0.2, -0.2, 0.0]), "throttle 0.1 of 2 mph, steering to the right"
    assert driven.speed_mph[0] == 10
    assert driven.time_s[:3].tolist() == pytest.approx([0, 0.1, 0.2])
    _, world = straight(MAPPED, speed=4)
    assert world.environment.unwrapped.actions[0][0] == 0
    assert world.environment.unwrapped.actions[0][2] > 0, "the brake is a component of its own"


def test_a_key_that_changes_nothing_is_refused() -> None:
    alone = MAPPED.replace("throttle:", "# ")
    for key, value in {"frame_rate": 7, "margin": 1.0, "speed": 9, "throttle": "network"}.items():
        with pytest.raises(InputError, match=rf"^{key}: changes nothing in world=gymnasium"):
            straight(alone, **{key: value})
    _, world = straight(MAPPED.replace("frame_rate: 10", ""), frame_rate=7)
    assert world.frame_rate == 7
    with pytest.raises(InputError, match=r"^frame_rate: changes nothing"):
        open_world(Scenario(world="gymnasium:drivezoo/Lake-v0", frame_rate=5))


def test_no_cross_track_error_leaves_the_autonomy_unmeasured() -> None:
    driven, _ = straight(MAPPED)
    figures = measure(driven)
    assert np.isnan(figures["autonomy"])
    assert figures["episode_return"] == 8
    summary = {key: None if np.isnan(value) else value for key, value in figures.items()}
    pooled = mean_and_spread([summary])
    assert "drives_without_intervention" not in pooled
    assert how_well(pooled) == "autonomy not measured, return 8.0"


def test_a_report_without_a_cross_track_error_has_its_verdict_and_drives(tmp_path: Path) -> None:
    Path("small.yaml").write_text(MAPPED)
    options = EvaluateOptions(world="small.yaml", seeds=2, film=True, out=tmp_path / "a")
    evaluation = score_driver(as_policy(lambda frame, mph: (0.0, None)), options, Console())
    markdown = (evaluation.folder / "report" / "report.md").read_text()
    assert "**Unknown whether it drives.**" in markdown
    assert "| Autonomy, small.yaml | not measured |" in markdown
    assert "[Film of the scored drive.]" in markdown
    assert "No worst moments: " in markdown
    assert "or no cross-track error." in markdown
    assert "could not be written" not in markdown
    assert ".png" not in markdown, "a plot of no error"


def test_an_intervention_begins_another_episode_of_the_same_drive() -> None:
    driven, _ = straight(MAPPED + ROAD)
    assert driven.time_s[-1] == pytest.approx(2.9)
    assert driven.intervention.sum() == 3, "the wall, once in each episode"
    assert measure(driven)["autonomy"] == 0
    assert driven.episode_return == 30 / 4
    turn, _ = straight(MAPPED + ROAD, steering=1.0)
    assert abs(turn.cross_track_m[turn.intervention]).min() > 2, "half of the width"


def test_an_episode_that_ends_off_the_road_is_an_intervention_at_any_margin() -> None:
    scenario = Scenario(world="gymnasium:drivezoo/Lake-v0", margin=20)
    driven = drive(lambda *_: (0.02, None), open_world(scenario), scenario, first_only=True)
    assert driven.intervention.sum() == 1


def test_laps_are_counted_over_all_episodes_of_a_drive() -> None:
    driven, _ = straight(MAPPED + ROAD + "lap: {place: info.lap}\n")
    assert len(driven.lap_s) == 7, "two in each of three episodes, and one in the last"


def test_a_drive_is_recorded_without_the_frames_of_its_interventions(tmp_path: Path) -> None:
    Path("small car.yaml").write_text(MAPPED + ROAD)
    policy, keep = as_policy(lambda frame, mph: (0.1, -0.5)), KeptDrive(tmp_path / "a", record=True)
    scenario = Scenario(world="small car.yaml", throttle="network")
    (figures,) = all_drives(policy, [scenario], keep)
    assert figures["interventions"] == 3
    recording = read_recordings(str(tmp_path / "a"))
    assert len(recording) == 30
    assert np.diff(recording.time_s).round(2).tolist().count(0.1) == 26, "four passes"
    assert set(recording.brake) == {0.5}
    assert recording.image(0).shape == (8, 12, 3)
    assert other_car(recording) == "small_car", "the embedded tracks show another camera"


def test_a_film_plays_at_the_environments_own_rate(tmp_path: Path) -> None:
    Path("small.yaml").write_text(MAPPED + ROAD)
    scenario = Scenario(world="small.yaml", throttle="network")
    all_drives(as_policy(lambda frame, mph: (0.1, -0.5)), [scenario], KeptDrive(tmp_path / "a", 1))
    assert next(imageio_ffmpeg.read_frames(str(tmp_path / "a/film.mp4")))["fps"] == 10


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e308])
def test_a_number_that_no_car_has_is_unknown(value: float) -> None:
    gymnasium.registry["SmallCar-v0"].kwargs["fault"] = value
    driven, world = straight(MAPPED + ROAD + "lap: {place: info.side}\n", speed=12)
    assert driven.speed_mph[0] == 10
    assert np.isnan(driven.speed_mph[1:3]).all()
    assert np.isnan(driven.cross_track_m[1:3]).all()
    assert world.environment.unwrapped.actions[1][0] == 0, "no throttle for an unknown speed"


@pytest.mark.parametrize(
    ("text", "fault", "line"),
    [
        (MAPPED.replace("Car-v0", "Cat-v0"), "", r"^track=small.yaml: no such.*SmallCar-v0\?"),
        (MAPPED.replace("SmallCar", "os:SmallCar"), "", r"names a module.*parts=os"),
        (MAPPED + "module: os\n", "", r"^small.yaml: unknown key module"),
        (MAPPED.replace("env.car", "env.__class__"), "", r"^small.yaml: speed: place: "),
        (MAPPED.replace("car.speed", "car.sped"), "", r"env.car.sped: the environment gives no"),
        (MAPPED.replace("car.speed", "car"), "", r"env.car is Car, not a number"),
        (MAPPED.replace("full: -0.5", "full: 2"), "", r"steering: full: 2; .* 1 is -0.5..0.5"),
        (MAPPED.replace("component: 2", "component: 3"), "", r"brake: component: 3; it has 3"),
        (MAPPED.replace("speed:", "lap:"), "", r"gives no speed to hold; .*speed:"),
        (MAPPED + "interventions: [observation.0]", "", r"interventions: .* has 288 values"),
        (MAPPED, "grey", r"observation.0 is uint8 \[8, 12, 1\], .* image:"),
        (MAPPED, "size", r"image changed from \(8, 12, 3\) to \(9, 12, 3\)"),
        (MAPPED, "reset", r"^track=small.yaml: its reset raised RuntimeError: no road$"),
    ],
)
def test_a_fault_is_one_line(text: str, fault: str, line: str) -> None:
    gymnasium.registry["SmallCar-v0"].kwargs["fault"] = fault
    with pytest.raises(InputError, match=line) as raised:
        straight(text)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("call", ["register", "gymnasium.register", "if True:\n    gym.register"])
def test_a_users_file_registers_an_environment(
    call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRIVEZOO_PARTS", "")
    monkeypatch.setattr("sys.path", sys.path.copy())
    part = tmp_path / f"own_car_{len(call)}.py"
    code = "import gymnasium\nimport gymnasium as gym\nfrom gymnasium import register\n"
    part.write_text(f"{code}{call}('OwnCar-v0', '{__name__}:SmallCar')\n")
    name_parts([str(part)])
    try:
        straight(MAPPED.replace("SmallCar", "OwnCar"))
    finally:
        gymnasium.registry.pop("OwnCar-v0", None)


def test_an_id_is_the_world_itself_and_excludes_a_track() -> None:
    scenario = Scenario(world="gymnasium:SmallCar-v0")
    assert (scenario.world, scenario.track) == ("gymnasium", "SmallCar-v0")
    with pytest.raises(InputError, match=r"^track=mountain: .*drop one"):
        Scenario("mountain", world="gymnasium:SmallCar-v0")
    with pytest.raises(InputError, match=r"highway-env|no such environment"):
        open_world(Scenario(world="gymnasium:racetrack-none"))


@pytest.mark.parametrize(
    ("name", "line"),
    [("Lak-v0", "^track=Lak-v0: "), ("os:Lake-v0", "^track=os:Lake-v0: names a module.*parts=os")],
)
def test_an_unknown_environment_is_named_and_imports_nothing(name: str, line: str) -> None:
    with pytest.raises(InputError, match=line):
        open_world(Scenario(name, world="gymnasium"))


@pytest.mark.parametrize("name", ["car_racing", "donkey", "racetrack"])
def test_a_known_environment_is_mapped(name: str) -> None:
    env = OmegaConf.load(choice_files("environment")[name]).env.replace("*", "v0")
    mapping, is_mapped = find_environment(env)
    assert is_mapped
    assert mapping.env == env


def test_a_file_for_a_known_environment_replaces_the_keys_that_it_has() -> None:
    Path("own.yaml").write_text("env: CarRacing-v3\nseconds: 5\n")
    environment, _ = find_environment("own.yaml")
    packaged, _ = find_environment("CarRacing-v3")
    assert environment == packaged.model_copy(update={"seconds": 5.0})


@pytest.fixture
def opened() -> Iterator[tuple[World, Scenario]]:
    scenario = Scenario("Lake-v0", world="gymnasium")
    world = open_world(scenario)
    yield world, scenario
    world.close()
