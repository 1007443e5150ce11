"""A world of drivezoo as LeRobot's own commands open it."""

import numpy as np
import pytest

pytest.importorskip("lerobot", reason="LeRobot has an environment of its own")


def test_lerobot_opens_a_world_with_the_names_of_a_converted_dataset() -> None:
    from lerobot.configs.parser import load_plugin
    from lerobot.envs.configs import EnvConfig
    from lerobot.envs.factory import make_env

    load_plugin("zoo.extras.hub.lerobot")  # --env.discover_packages_path
    kind = EnvConfig.get_choice_class("drivezoo")  # --env.type
    config = kind(observation_height=48, observation_width=96, seconds=1.0)
    world = make_env(config)["drivezoo"][0]
    observation, _ = world.reset(seed=[1])
    assert observation["pixels"]["center"].shape == (1, 48, 96, 3)
    assert observation["agent_pos"].shape == (1, 2)
    for _ in range(world.call("_max_episode_steps")[0]):
        _, _, _, truncated, info = world.step(np.array([[0.0, 0.2, 0.0]], np.float32))
    world.close()
    assert truncated.all()
    assert info["final_info"]["is_success"].all()
