"""The Gymnasium environments, alone and in parallel, drawn by the software renderer."""

import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import zoo.simulator  # noqa: F401 - registers Lake-v0
from tests.refusals import refusal
from tests.slow_members import slow_but
from tests.zoo.simulator.tracks import LOOP, write_track
from zoo.base.errors import InputError
from zoo.simulator.env import DrivingEnv
from zoo.simulator.expert import Expert
from zoo.simulator.reward import REWARDS, TERMINATIONS
from zoo.simulator.track_names import environment_id, family_names, track_names
from zoo.simulator.weather import Weather

STRAIGHT_ON = np.array([0.0, 0.5], np.float32)
SMALL = {"width": 32, "height": 16}  # for tests of many steps
Opened = Callable[..., DrivingEnv]


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opened]:
    """Return a function that opens an environment on a short loop until the test ends."""
    bare = {"trees": 5, "bushes": 0, "rocks": 5}
    track = write_track(tmp_path, points=LOOP, surroundings=bare)
    envs = []

    def make(**arguments) -> DrivingEnv:
        envs.append(DrivingEnv(track, renderer="software", **arguments))
        return envs[-1]

    yield make
    for env in envs:
        env.close()


@pytest.mark.parametrize("track", slow_but(["zoo_lake"], (*track_names(), *family_names())))
@pytest.mark.parametrize(
    "arguments",
    [pytest.param({}, marks=pytest.mark.slow), {"cameras": "all", "render_mode": "rgb_array"}],
)
def test_gymnasiums_checker_finds_no_fault(track, arguments):
    env = gymnasium.make(f"drivezoo/{environment_id(track)}", renderer="software", **arguments)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
    env.close()


def test_importing_the_simulator_registers_it_and_a_checked_world_loads_no_renderer():
    """A training checks at its start the worlds that it drives in at its end."""
    lines = """
import sys, gymnasium, zoo.simulator
assert gymnasium.spec("Lake-v0").kwargs == {"track": "lake"}
from zoo.simulator.expert import Expert
from zoo.simulator.simulated_world import open_world
open_world("lake", renderer="none")
assert "panda3d" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", lines], check=True)


ALONE = """import sys, drivezoo
assert not {'gymnasium', 'numpy', 'pydantic'} & set(sys.modules)
import gymnasium"""


@pytest.mark.parametrize("imports", [ALONE, "import gymnasium, drivezoo"], ids=["first", "last"])
def test_importing_drivezoo_registers_it_in_either_order_and_imports_neither(imports):
    lines = f"{imports}; gymnasium.spec('Lake-v0'); gymnasium.spec('drivezoo/Alpine-v0')"
    subprocess.run([sys.executable, "-c", lines], check=True)


def test_gymnasium_imports_the_package_named_in_the_id():
    lines = """
import gymnasium
env = gymnasium.make("drivezoo:drivezoo/Lake-v0", renderer="software", quality="simple")
print(env.reset(seed=0)[1]["lap"])
"""
    done = subprocess.run([sys.executable, "-c", lines], check=True, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("0\n", "")


def test_the_image_is_the_centre_camera_and_the_others_come_on_request(opened):
    obs, _ = opened().reset(seed=1)
    env = opened(cameras="all")
    all_obs, _ = env.reset(seed=1)
    assert set(obs) == {"image", "speed"}
    assert set(all_obs) == {"image", "left", "right", "speed"}
    assert np.array_equal(obs["image"], all_obs["image"])
    assert np.array_equal(all_obs["left"], env.world.frame("left"))


def test_the_same_seed_and_actions_give_the_same_frames_to_the_bit(opened):
    arguments = {"weather": "random", "random_start": True}
    first, second = (drive_at_random(opened(**arguments), seed=5) for _ in range(2))
    np.testing.assert_equal(first, second)


def drive_at_random(env: DrivingEnv, seed: int) -> list[tuple[dict, dict]]:
    """Return observations and infos of two episodes, the second without a seed."""
    rng = np.random.default_rng(seed)
    seen = []
    for episode_seed in (seed, None):
        seen.append(env.reset(seed=episode_seed))
        for _ in range(5):
            observation, *_, info = env.step(rng.uniform((-0.3, 0), (0.3, 1)))
            seen.append((observation, info))
    return seen


def test_each_seed_begins_at_another_place_and_day_unless_that_is_switched_off(opened):
    env, fixed = opened(weather="random", **SMALL), opened(random_start=False, **SMALL)
    places, days = set(), set()
    for seed in (3, 4, 3):
        places.add(env.reset(seed=seed)[1]["distance"])
        days.add(env.world.weather.sun_azimuth_deg)
    assert len(places) == len(days) == 2
    assert {fixed.reset(seed=seed)[1]["distance"] for seed in (3, 4)} == {0}


def test_direction_and_weather_take_the_words_of_the_commands(opened):
    env = opened(direction="backward", weather={"fog": 0.4})
    env.reset(seed=0, options={"speed_mph": 20})
    assert env.world.weather == Weather(fog=0.4)
    assert env.step(STRAIGHT_ON)[1] > 0.4
    env.reset(options={"weather": "{wet: 1}"})
    assert env.world.weather == Weather(wet=1)


def test_a_throttle_below_zero_brakes_and_never_reverses(opened):
    env = opened(frame_rate=10, **SMALL)
    env.reset(seed=0, options={"speed_mph": 20})
    brake = np.array([0, -1], np.float32)
    rewards = [env.step(brake)[1] for _ in range(40)]
    assert min(rewards) >= 0
    assert sum(rewards) > 1
    assert env.step(brake)[0]["speed"] == [0]


def test_reset_takes_place_and_weather_of_the_start(opened):
    fog = Weather(fog=0.6)
    options = {"distance": 50, "cte": 1, "heading_deg": -4, "speed_mph": 12, "weather": fog}
    env = opened()
    observation, info = env.reset(seed=0, options=options)
    assert (info["distance"], info["cte"]) == pytest.approx((50, 1), abs=0.05)
    assert np.degrees(info["heading_error"]) == pytest.approx(-4, abs=0.5)
    assert observation["speed"] == pytest.approx([12])
    assert env.world.weather == fog
    env.reset()
    assert env.world.weather == Weather()


@pytest.mark.parametrize(("off_road_s", "steps"), [(0, 1), (0.5, 6)])
def test_off_the_road_there_is_no_reward_and_then_no_more_time(opened, off_road_s, steps):
    env = opened(off_road_s=off_road_s, frame_rate=10, **SMALL)
    env.reset(seed=0, options={"cte": 6, "speed_mph": 5})
    for step in range(1, steps + 1):
        _, reward, terminated, truncated, info = env.step(STRAIGHT_ON)
        assert info["off_road"]
        assert reward == 0
        assert (terminated, truncated) == (step == steps, False)


def test_the_seed_chooses_a_familys_road_and_an_option_another():
    env = DrivingEnv("alpine:*", renderer="software", quality="simple", width=64, height=32)
    roads = []
    for seed, options in ((17, {}), (None, {}), (17, {"seed": 5}), (2**31 + 17, {}), (17, {})):
        frame, _ = env.reset(seed=seed, options=options)
        roads.append(env.world.track.name)
    assert roads[0] == roads[3] == roads[4] == "alpine:17"
    assert roads[2] == "alpine:5"
    assert roads[1] not in roads[2:]
    assert np.array_equal(env.reset(seed=17)[0]["image"], frame["image"])
    with pytest.raises(InputError, match=r"unknown option road; available: .*\bseed\b"):
        env.reset(options={"road": 5})
    env.close()


def test_images_have_the_size_and_the_field_of_view_of_the_arguments(opened):
    arguments = {"width": 96, "height": 64, "cameras": "all", "random_start": False}
    wide, narrow = (opened(**arguments, vertical_fov_deg=degrees) for degrees in (80, 40))
    frames = [env.reset(seed=0)[0] for env in (wide, narrow)]
    assert {frame[key].shape for frame in frames for key in ("image", "left")} == {(64, 96, 3)}
    assert wide.observation_space.contains(frames[0])
    assert wide.rig.cameras["right"].vertical_fov_deg == 80
    assert not np.array_equal(frames[0]["image"], frames[1]["image"])


INFO = {"cte": -2.0, "width": 6.0, "hit": False, "off_road": False, "speed_mph": 10.0, "lap": 0}
BEFORE, AFTER = {"driven_m": 5.0, "furthest": 0.25}, {"driven_m": 7.0, "furthest": 0.5}


@pytest.mark.parametrize(
    ("name", "changes", "terminated", "reward"),
    [
        ("progress", {}, False, 2),
        ("progress", {"off_road": True}, False, 0),
        ("donkeycar", {}, False, 0.75 * 4.4704),
        ("donkeycar", {}, True, -1),
        ("donkeycar", {"cte": -8.1}, False, -1),
        ("donkeycar", {"hit": True}, False, -2),
        ("carracing", {}, False, 249.9),
        ("carracing", {"furthest": 0.25}, False, -0.1),
        ("carracing", {"cte": 83.0}, True, -100),
        ("carracing", {"lap": 1}, True, 249.9),
    ],
)
def test_a_named_reward_is_the_formula_of_its_environment(name, changes, terminated, reward):
    assert REWARDS[name](BEFORE, INFO | AFTER | changes, terminated) == pytest.approx(reward)


@pytest.mark.parametrize(
    ("name", "changes", "ends"),
    [
        ("donkeycar", {}, False),
        ("donkeycar", {"cte": -8.1}, True),
        ("donkeycar", {"hit": True}, True),
        ("carracing", {"cte": 82.0}, False),
        ("carracing", {"cte": 83.0}, True),
        ("carracing", {"lap": 1}, True),
    ],
)
def test_a_named_termination_is_the_rule_of_its_environment(name, changes, ends):
    assert TERMINATIONS[name](INFO | changes) == ends


def test_functions_of_ones_own_give_reward_and_termination(opened):
    env = opened(
        reward=lambda before, info, terminated: info["time"] - before["time"] + 10 * terminated,
        termination=lambda info: info["time"] > 0.3,
        frame_rate=5,
    )
    env.reset(seed=0)
    rewards, ends = zip(*[env.step(STRAIGHT_ON)[1:3] for _ in range(2)], strict=True)
    assert ends == (False, True)
    assert rewards == pytest.approx([0.2, 10.2])


@pytest.mark.parametrize("direction", [1, -1])
def test_it_ends_when_the_laps_are_driven(opened, direction):
    env = opened(laps=1, frame_rate=5, direction=direction, **SMALL)
    env.reset(seed=0, options={"speed_mph": 25})
    expert, terminated = Expert(env.world.track), False
    while not terminated and env.world.time < 60:
        *_, terminated, _, info = env.step(expert(env.world))
    assert terminated
    assert info["lap"] == 1
    assert info["progress"] == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize(
    ("limits", "steps"),
    [
        ({"max_seconds": 0.5, "frame_rate": 10}, 5),
        ({"laps": None, "frame_rate": 0.2}, 60),  # 300 s
        pytest.param({"laps": 2, "frame_rate": 0.2}, 120, marks=pytest.mark.slow),
    ],
)
def test_an_episode_of_a_standing_car_is_cut_off(opened, limits, steps):
    env = opened(**limits, **SMALL)
    env.reset(seed=0)
    ends = [env.step(np.zeros(2, np.float32))[2:4] for _ in range(steps)]
    assert ends == [(False, False)] * (steps - 1) + [(False, True)]


def test_it_renders_what_was_last_seen(opened):
    env = opened(render_mode="rgb_array", frame_rate=20)
    assert env.metadata["render_fps"] == 20
    env.reset(seed=0)
    observation, *_, info = env.step(STRAIGHT_ON)
    seen = observation["image"].copy()
    observation["image"][:], info["driven_m"] = 0, -9.0  # as a wrapper may
    assert np.array_equal(env.render(), seen)
    assert env.step(STRAIGHT_ON)[1] < 1, "the reward is not of the changed info"
    silent = opened()
    silent.reset(seed=0)
    assert silent.render() is None
    silent.close()  # the fixture closes it once more, without effect


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ({"cameras": "rear"}, "cameras=rear: must be center or all"),
        ({"render_mode": "human"}, "render_mode=human"),
        ({"renderer": "none"}, "renderer=none"),
        ({"direction": "left"}, "direction=left: must be forward or backward"),
        ({"laps": 0}, "laps=0: must be 1 or more"),
        ({"max_seconds": -1}, "max_seconds=-1"),
        ({"off_road_s": -1}, "off_road_s=-1"),
        ({"off_road_s": None}, "off_road_s=None: must be 0 or more; inf"),
        ({"track": "lagoon"}, "no track lagoon"),
        ({"track": "lagoon:*"}, "no family of roads 'lagoon'"),
        ({"track": Path("lagoon")}, "no track lagoon"),
        ({"laps": "2"}, "laps=2: must be 1 or more"),
        ({"width": 4}, "width=4: must be 8 to 1024"),
        ({"width": 10.5}, "width=10.5: must be 8 to 1024, a whole number"),
        ({"reward": 3}, "reward=3: available: progress"),
        ({"random_start": "never"}, "random_start=never: must be true or false"),
        ({"vertical_fov_deg": 0}, "vertical_fov_deg=0: must be 1 to 170"),
        ({"reward": "donkey"}, "reward=donkey: did you mean donkeycar"),
        ({"termination": "lap"}, "termination=lap: available: off_road, donkeycar, carracing"),
    ],
)
def test_a_wrong_argument_is_refused(argument, message):
    assert message in refusal(DrivingEnv, **argument)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"speed": 5}, "unknown option speed; available: cte, distance"),
        ({"speed_mph": 70}, "speed_mph=70: must be a number in 0..30"),
        ({"distance": "far"}, "distance=far: must be a number"),
        ({"cte": np.nan}, "nan: must be a finite number"),
    ],
)
def test_a_wrong_option_of_reset_is_refused(opened, option, message):
    assert message in refusal(opened().reset, options=option)


@pytest.mark.parametrize("call", [lambda env: env.step(STRAIGHT_ON), DrivingEnv.render])
def test_an_episode_begins_with_a_reset(opened, call):
    env = opened(render_mode="rgb_array", **SMALL)
    for _ in range(2):
        with pytest.raises(InputError, match="call its reset first"):
            call(env)
        env.reset(seed=1)
        env.close()


@pytest.mark.parametrize("action", [[np.nan, 0], [0.1], [0, np.inf], "left"])
def test_an_action_is_two_finite_numbers(opened, action):
    env = opened()
    env.reset(seed=np.int64(0))
    assert "two finite numbers" in refusal(env.step, action)


SETTINGS = {"renderer": "software", "weather": "random", "random_start": True, "cameras": "all"}
STEPS = 12


@pytest.mark.slow
def test_parallel_environments_equal_sequential_ones():
    rng = np.random.default_rng(3)
    actions = rng.uniform((-0.3, 0.0), (0.3, 1.0), (STEPS, 2, 2)).astype(np.float32)
    drives = []
    for mode, keywords in (("sync", {}), ("async", {"context": "spawn"})):
        envs = gymnasium.make_vec("Lake-v0", 2, mode, vector_kwargs=keywords, **SETTINGS)
        observation, info = envs.reset(seed=7)
        drives.append([observation | info])
        for action in actions:
            observation, reward, _, _, info = envs.step(action)
            drives[-1].append({**observation, **info, "reward": reward})
        envs.close()
    for alone, parallel in zip(*drives, strict=True):
        assert alone.keys() == parallel.keys()
        for key, value in alone.items():
            assert np.array_equal(value, parallel[key]), key
