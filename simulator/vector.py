"""Several driving environments in parallel, one process each."""

from functools import partial

from gymnasium.vector import AsyncVectorEnv

from simulator.env import DrivingEnv
from simulator.errors import SimulatorError


def open_vector(track: str, count: int, **settings: object) -> AsyncVectorEnv:
    """Open `count` environments `DrivingEnv(track, **settings)` as one Gymnasium vector.

    Each environment runs in its own process, because rendering keeps a core busy. Frames return
    through shared memory. `reset(seed=7)` seeds the environments 7, 8, 9 ... The processes are
    spawned, because threads of Panda3D and PyTorch do not survive a fork. Therefore the calling
    script needs `if __name__ == "__main__":`.

    Raises:
        SimulatorError: the count is below 1.
    """
    if count < 1:
        raise SimulatorError(f"count={count}: must be 1 or more")
    make = partial(DrivingEnv, track, **settings)
    return AsyncVectorEnv([make] * count, context="spawn")
