"""Many drives at once, a process each."""

from functools import partial

from gymnasium.vector import AsyncVectorEnv

from simulator.env import DrivingEnv
from simulator.errors import SimulatorError


def open_vector(track: str, count: int, **settings: object) -> AsyncVectorEnv:
    """`count` environments of `DrivingEnv(track, **settings)` as one of Gymnasium's own.

    Processes, since a frame is work and not waiting; frames come back through shared memory.
    `reset(seed=7)` seeds them 7, 8, 9 ... The processes are spawned: Panda3D's and PyTorch's
    threads do not survive a fork. So the calling script needs `if __name__ == "__main__":`.

    Raises:
        SimulatorError: a count below 1.
    """
    if count < 1:
        raise SimulatorError(f"count={count}: must be 1 or more")
    make = partial(DrivingEnv, track, **settings)
    return AsyncVectorEnv([make] * count, context="spawn")
