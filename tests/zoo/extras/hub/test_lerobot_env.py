"""A world of drivezoo as LeRobot's own commands open it."""

import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zoo.base.rig import MPS_PER_MPH
from zoo.extras.hub.lerobot.lerobot_world import open_lerobot_world
from zoo.simulator.simulated_world import Start

PAGE = Path(__file__).parents[4] / "docs" / "gymnasium.md"


def test_lerobot_opens_a_world_with_the_names_of_a_converted_dataset() -> None:
    pytest.importorskip("lerobot", reason="LeRobot has an environment of its own")
    from lerobot.configs.parser import load_plugin
    from lerobot.envs.configs import EnvConfig
    from lerobot.envs.factory import make_env

    load_plugin("zoo.extras.hub.lerobot")  # --env.discover_packages_path
    kind = EnvConfig.get_choice_class("drivezoo")  # --env.type
    config = kind(observation_height=48, observation_width=96, seconds=1.0, fps=10)
    world = make_env(config)["drivezoo"][0]
    observation, _ = world.reset(seed=[1])
    assert observation["pixels"]["center"].shape == (1, 48, 96, 3)
    assert observation["agent_pos"].shape == (1, 2)
    assert isinstance(world.metadata["render_fps"], int)  # PyAV writes no video otherwise
    for _ in range(10):
        _, _, _, truncated, info = world.step(np.array([[0.0, 0.2, 0.0]], np.float32))
    world.close()
    assert truncated.all()
    assert info["final_info"]["is_success"].all()


def test_the_environment_for_lerobot_has_the_units_of_a_converted_dataset(tmp_path: Path) -> None:
    block = re.search(r"```python\n(# env\.py\n.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "env.py").write_text(block[1])
    envs = runpy.run_path(str(tmp_path / "env.py"))["make_env"](2)
    observation, _ = envs.reset(seed=[1, 2], options={"lerobot_new_rollout": True})
    assert observation["pixels"]["center"].shape == (2, 160, 320, 3)
    assert envs.call("_max_episode_steps") == (451, 451)
    for _ in range(5):
        observation, *_, info = envs.step(np.array([[0, 1, 0.2], [0, 0.5, 0.5]], np.float32))
    mph, mps = observation["agent_pos"].T
    assert mph[0] > 1
    assert mph[1] == pytest.approx(0, abs=0.5), "the brake takes the throttle back"
    assert mps == pytest.approx(mph * MPS_PER_MPH, rel=1e-4)
    assert not info["is_success"].any()
    envs.close()


@pytest.mark.parametrize(("cte", "success"), [(0.0, True), (4.0, False)])
def test_an_open_roads_end_is_a_success_on_the_road(cte: float, success: bool) -> None:
    env = open_lerobot_world("Alpine-v0", 30, width=16, height=8, quality="simple")
    env.reset(seed=1)
    inner: Any = env.unwrapped
    length = inner.world.track.length
    inner.world.reset(0, Start(distance=length - 1, cte=cte, speed_mph=20))
    terminated = False
    while not terminated:
        _, _, terminated, truncated, info = env.step([0, 0, 0])
    env.close()
    assert info["is_success"] is success
    assert not truncated


@pytest.mark.parametrize("seconds", [0.1, 0.4666, 1.5])
def test_the_end_of_the_time_comes_before_lerobots_last_step(seconds: float) -> None:
    env = open_lerobot_world("Lake-v0", seconds, width=16, height=8, quality="simple")
    env.reset(seed=1)
    for _ in range(env._max_episode_steps):
        _, _, _, truncated, info = env.step([0, 0, -1])
        if truncated:
            break
    env.close()
    assert info["is_success"]
    assert info["speed_mph"] == 0, "a brake below 0 is none, and no throttle"
