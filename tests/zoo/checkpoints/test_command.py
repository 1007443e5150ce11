"""The command of a policy, and a plain function as a policy."""

from zoo.checkpoints.command import Command, Policy, as_policy
from zoo.worlds.drive_loop import drive
from zoo.worlds.open_world import open_world
from zoo.worlds.scenario import Scenario


class Counting(Policy):
    """A policy that turns off the road, and counts resets."""

    resets = 0

    def __call__(self, frame, speed_mph: float) -> Command:
        return Command(0.5)

    def reset(self) -> None:
        self.resets += 1


def test_a_pair_is_a_command_without_doubt() -> None:
    assert as_policy(lambda frame, mph: (0.1, None))(None, 9.0) == Command(0.1, None, None)


def test_a_command_unpacks_as_the_pair_that_policies_once_returned() -> None:
    steering, throttle = Command(0.1, 0.2, spread=0.3)
    assert (steering, throttle) == (0.1, 0.2) == tuple(Command(0.1, 0.2))
    assert Command(0.1, 0.2)[0] == 0.1


def test_a_drive_resets_the_policy_at_its_start_and_after_each_intervention() -> None:
    policy, scenario = Counting(), Scenario("lake", 1, laps=0.1, speed=9.0)
    driven = drive(policy, open_world(scenario, "none"), scenario)
    assert driven.intervention.sum() > 1
    assert policy.resets == 1 + driven.intervention.sum()
