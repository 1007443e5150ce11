"""Light and weather, as settings and as words."""

import re

import numpy as np
import pytest

from simulator.weather import CLEAR, Weather, random_weather, read_weather
from zoo.base.errors import InputError


def test_the_words_of_the_commands() -> None:
    assert read_weather("clear") == CLEAR
    assert read_weather("random") == "random"
    assert read_weather("{fog: 0.4, shadows: false}") == Weather(fog=0.4, shadows=False)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("foggy", "must be clear, random or settings"),
        ("{fogg: 1}", "there is no fogg; did you mean fog?"),
        ("{fog: 2}", "fog=2: must be in 0..1"),
        ("{fog: thick}", "fog=thick: must be a number"),
        ("{camera: {pich_deg: 2}}", "did you mean pitch_deg?"),
        ("{camera: 3}", "camera: must be settings"),
        ("{fog: [", "must be clear, random or settings"),
    ],
)
def test_a_wrong_weather_is_named(text: str, words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        read_weather(text)


def test_a_random_day_is_the_same_for_the_same_seed_and_another_for_another() -> None:
    days = [random_weather(np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert days[0] == days[1] != days[2]


def test_random_days_are_of_every_kind() -> None:
    days = [random_weather(np.random.default_rng(seed)) for seed in range(200)]
    for kind in ("fog", "rain", "wet"):
        share = np.mean([getattr(day, kind) > 0 for day in days])
        assert 0.1 < share < 0.45
    assert 0.6 < np.mean([day.shadows for day in days]) < 0.95
