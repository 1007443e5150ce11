"""Several environments in parallel processes."""

import gymnasium
import numpy as np

import simulator  # noqa: F401 - registers Lake-v0
from simulator.env import DrivingEnv

SETTINGS = {"renderer": "software", "weather": "random", "random_start": True, "cameras": "all"}
STEPS = 12


def test_parallel_environments_equal_sequential_ones():
    rng = np.random.default_rng(3)
    actions = rng.uniform((-0.3, 0.0), (0.3, 1.0), (STEPS, 2, 2)).astype(np.float32)
    spawn = {"context": "spawn"}
    envs = gymnasium.make_vec(
        "Lake-v0", 2, vectorization_mode="async", vector_kwargs=spawn, **SETTINGS
    )
    together = [(*envs.reset(seed=7), None)]
    for action in actions:
        observation, reward, _, _, info = envs.step(action)
        together.append((observation, info, reward))
    envs.close()
    env = DrivingEnv("lake", **SETTINGS)
    for index in range(2):
        alone = [(*env.reset(seed=7 + index), None)]
        for action in actions[:, index]:
            observation, reward, _, _, info = env.step(action)
            alone.append((observation, info, reward))
        for one, all_ in zip(alone, together, strict=True):
            for key, value in one[0].items():
                assert np.array_equal(value, all_[0][key][index]), key
            for key, value in one[1].items():
                assert value == all_[1][key][index], key
            assert one[2] is None or one[2] == all_[2][index]
    env.close()
