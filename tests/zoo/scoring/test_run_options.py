"""A run's `score`: the keys of an evaluation, their defaults, and the throttle."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from tests.zoo.command_runs import only_line, run_here
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.checkpoints.policy_base import as_policy
from zoo.driving.drive_loop import drive
from zoo.driving.open_world import open_world
from zoo.driving.run_drives import check_throttle
from zoo.driving.scenario import Scenario
from zoo.scoring.track_scores import expert_steering_per_s, run_options
from zoo.simulator.expert import Expert
from zoo.simulator.track_names import track_folder


def test_the_world_can_be_set_for_the_score() -> None:
    typed = ["score.delay_s=0.1", "score.weather={fog:0.4}", "score.direction=-1"]
    options = run_options(OmegaConf.create(compose_config(typed)["score"]))
    assert (options.delay_s, options.direction, options.quality) == (0.1, -1, "full")
    assert "fog" in options.weather


def test_a_score_has_the_defaults_of_an_evaluation_for_what_it_lacks() -> None:
    some = {"track": "lake", "laps": 1.0, "seeds": 1, "speed": 15.0, "candidate_laps": 1.0}
    now = compose_config([])["score"]
    given = OmegaConf.create(some | {"film": True, "film_speed": 3.0})
    assert run_options(given) == run_options(OmegaConf.create(now))


@pytest.mark.parametrize(
    ("score", "words"),
    [
        ({"lap": 1}, "did you mean laps"),
        ({"laps": [1]}, "laps"),
        ({"laps": "many"}, "laps=many: must be a number"),
        ({"delay_s": 9}, "delay_s=9: must be .*0..2"),
        ({"track": "nowhere"}, "nowhere"),
    ],
)
def test_a_mistake_in_the_score_is_named_before_training(score: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        run_options(OmegaConf.create(score))


def speeds(scenario: Scenario, throttle: float | None) -> np.ndarray:
    """Return the speeds in mph of a drive that steers like the expert."""
    world = open_world(scenario, "none")
    expert = Expert(world.simulated.track)
    policy = as_policy(lambda *_: (expert(world.simulated)[0], throttle))
    return drive(policy, world, scenario).speed_mph


def test_it_starts_from_a_standstill_and_goes_as_fast_as_its_throttle() -> None:
    scenario = Scenario("lake", 1, laps=0.3, speed=15, throttle="network")
    slow, fast = speeds(scenario, 0.1), speeds(scenario, 0.2)
    assert slow[0] == fast[0] == 0
    assert 5 < slow[-1] < fast[-1]
    assert (np.diff(slow[:60]) > 0).all()


def test_otherwise_its_throttle_is_not_asked_for() -> None:
    held = Scenario("lake", 1, laps=0.2, speed=15)
    assert speeds(held, 1.0) == pytest.approx(speeds(held, None))
    assert speeds(held, 1.0).mean() == pytest.approx(15, abs=0.5)


def test_a_network_that_gives_none_is_refused() -> None:
    with pytest.raises(InputError, match=r"throttle=network: .*no throttle"):
        check_throttle(as_policy(lambda frame, mph: (0.0, None)), "network")
    check_throttle(as_policy(lambda frame, mph: (0.0, 0.5)), "network")
    check_throttle(as_policy(lambda frame, mph: (0.0, None)), "hold")


def test_the_expert_beside_it_drives_with_its_own_throttle_too() -> None:
    per_s = [expert_steering_per_s(Scenario("lake", throttle=mode)) for mode in ("hold", "network")]
    assert per_s[0] < per_s[1], "it is faster, and so in more bends a second"


def test_the_expert_drives_a_file_as_it_is_now(tmp_path: Path) -> None:
    track, per_s = tmp_path / "own.yml", []
    for name in ("lake", "mountain"):
        track.write_text((track_folder() / f"zoo_{name}.yaml").read_text())
        per_s.append(expert_steering_per_s(Scenario(str(track), speed=30)))
    assert per_s[0] != per_s[1]


def test_it_is_said_in_one_line(checkpoint, tmp_path) -> None:
    words = (checkpoint, "throttle=network")
    line = only_line(run_here(tmp_path, *words, module="zoo.commands.evaluate"))
    assert "no throttle; train model=nvidia_speed" in line
    assert list(tmp_path.iterdir()) == []
