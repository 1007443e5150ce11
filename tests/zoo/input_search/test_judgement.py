"""Judgement of a search's result, on outputs with known agreement."""

import numpy as np
import pytest

from datamodules.view import View
from zoo.input_search.combinations import SCALES, Combination
from zoo.input_search.judgement import judge
from zoo.input_search.trials import Trial, Trials, concordance

ROWS = 240
STEERING = np.sin(np.arange(ROWS) / 5) * np.linspace(0.2, 0.6, ROWS)


def trial(
    colour: str = "rgb",
    gain: float = 1.0,
    noise: float = 0.0,
    side: float = 0.25,
    resize: str = "area",
    crop: tuple[int, int] = (60, 25),
    seed: int = 0,
) -> Trial:
    """Return a trial whose outputs are the steering with a gain and noise."""
    rng = np.random.default_rng(seed)
    center = gain * STEERING + rng.normal(0, noise, ROWS)
    combination = Combination(View(crop, colour, (66, 200), resize), SCALES[0])
    return Trial(combination, center, center + side, center - side, STEERING)


def judged(*trials: Trial):
    ranked = sorted(trials, key=lambda one: -one.score)
    return judge(Trials(tuple(ranked), tuple(ranked)))


def test_a_network_that_steers_as_recorded_is_convincing() -> None:
    found = judged(trial(noise=0.1), trial("yuv", gain=0.3, noise=0.3, seed=1))
    assert found.doubts == ()
    assert found.best.combination.view.colour == "rgb"
    assert found.next.combination.view.colour == "yuv"
    assert 0 < found.chance < found.best.correlation


@pytest.mark.parametrize(
    ("doubtful", "reason"),
    [
        ({"gain": 0.0, "noise": 1.0}, "by chance"),
        ({"gain": 1.0, "noise": 0.62}, "correlation"),
        ({"gain": 0.05, "side": 0.01}, "spreads over 0.05 times"),
        ({"side": -0.25}, "recovery response"),
    ],
)
def test_a_doubt_names_its_reason(doubtful: dict, reason: str) -> None:
    others = [trial(colour, gain=0, noise=1, side=0, seed=1) for colour in ("yuv", "bgr")]
    found = judge(Trials((trial(**doubtful), *others), (trial(**doubtful), *others)))
    assert any(reason in one for one in found.doubts)


def test_chance_counts_all_inputs_that_were_tried() -> None:
    alone = judged(trial(gain=0, noise=1))
    many = judged(*(trial(gain=0, noise=1, seed=seed) for seed in range(40)))
    assert many.chance > alone.chance


def test_inputs_that_steer_the_same_are_named_and_the_usual_one_is_taken() -> None:
    found = judged(trial(resize="linear"), trial(noise=0.001), trial("yuv", noise=0.6))
    assert found.best.combination.view.resize == "area"
    assert [one.combination.view.resize for one in found.alike] == ["linear"]
    assert not found.tied


def test_inputs_that_cannot_be_told_apart_are_named() -> None:
    found = judged(trial("rgb", noise=0.2), trial("bgr", noise=0.2, seed=1))
    assert len(found.tied) == 1
    assert found.next is None


def test_concordance_sees_what_the_correlation_does_not() -> None:
    assert concordance(STEERING, STEERING) == pytest.approx(1)
    assert concordance(STEERING / 2, STEERING) < 0.9
    assert concordance(STEERING + 0.5, STEERING) < 0.5
    assert concordance(np.full(ROWS, np.nan), STEERING) == 0
    assert concordance(np.zeros(ROWS), np.zeros(ROWS)) == 0
