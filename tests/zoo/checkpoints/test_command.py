"""The command of a policy, and the state that a policy keeps for each car."""

from simulator.world import open_world
from zoo.checkpoints.command import Command, call_policy, own_session, reset_policy
from zoo.evaluate.embedded_drive import drive_closed_loop
from zoo.evaluate.many_drives import speed_controller


class Counting:
    """A policy that turns off the road, and counts frames and resets."""

    def __init__(self) -> None:
        self.frames, self.resets = 0, 0

    def __call__(self, frame, speed_mph: float) -> Command:
        self.frames += 1
        return Command(0.5)

    def reset(self) -> None:
        self.resets += 1

    def new_session(self) -> "Counting":
        return Counting()


def test_a_pair_is_a_command_without_doubt() -> None:
    assert call_policy(lambda frame, mph: (0.1, None), None, 9.0) == Command(0.1, None, None)


def test_a_command_unpacks_as_the_pair_that_policies_once_returned() -> None:
    steering, throttle = Command(0.1, 0.2, spread=0.3)
    assert (steering, throttle) == (0.1, 0.2) == tuple(Command(0.1, 0.2))
    assert Command(0.1, 0.2)[0] == 0.1


def test_a_plain_function_has_no_state() -> None:
    policy = lambda frame, mph: (0.1, None)  # noqa: E731
    reset_policy(policy)
    assert own_session(policy) is policy


def test_each_car_has_its_own_state() -> None:
    policy = Counting()
    assert own_session(policy) is not policy


def test_a_drive_resets_the_policy_at_its_start_and_after_each_intervention() -> None:
    policy, world = Counting(), open_world("lake", "none")
    drive = drive_closed_loop(policy, world, speed_controller(9.0), 1, 0.1)
    assert drive.intervention.sum() > 1
    assert policy.resets == 1 + drive.intervention.sum()
