"""A run's `score`: the keys of an evaluation, and their defaults."""

import pytest
from omegaconf import OmegaConf

from zoo.base.errors import InputError
from zoo.cli.compose import compose_config
from zoo.evaluate.track_scores import run_options


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
