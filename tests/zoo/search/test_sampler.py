"""The choice of roads: more cells with a failure than random drawing, and the same twice."""

import sys

import numpy as np
import pytest

from simulator.weather import CLEAR
from zoo.base.command_keys import read_options
from zoo.base.errors import InputError
from zoo.search.failure_map import Archive
from zoo.search.search_options import SearchOptions
from zoo.search.search_run import Driven, Outcome, search
from zoo.search.search_space import Candidate


def options_of(*given: str) -> SearchOptions:
    return read_options(SearchOptions, ["length=60", "weather=clear", *given])


def narrow_fails(chosen: list[Candidate]) -> list[Outcome]:
    """Fail on roads narrower than 5.4 m."""
    widths = [
        min(width for _, width in one.content.get("widths", [[0, one.content["width"]]]))
        for one in chosen
    ]
    return [
        Outcome(width < 5.4, 30.0, 5.0, 1.0 if width < 5.4 else 5.4 / width, 0) for width in widths
    ]


def searched(options: SearchOptions) -> tuple[list[Driven], Archive]:
    space = options.space()
    archive = options.archive(space)
    batches: list[int] = []
    found = search(options, space, archive, narrow_fails, lambda d: batches.append(len(d)))
    assert batches == [*range(8, options.budget, 8), options.budget]
    return found, archive


def test_the_archive_finds_more_failing_cells_than_random_drawing() -> None:
    by_sampler = {
        sampler: sum(
            len(searched(options_of("budget=80", f"sampler={sampler}", f"seed={seed}"))[1].failed)
            for seed in range(2)
        )
        for sampler in ("archive", "random")
    }
    assert by_sampler["archive"] > 1.2 * by_sampler["random"]


@pytest.mark.parametrize("sampler", ["archive", "tpe", "random", "family"])
def test_a_seed_gives_the_same_search(sampler: str) -> None:
    if sampler == "tpe":
        pytest.importorskip("optuna")
    options = options_of("budget=20", f"sampler={sampler}", "seed=3")
    (first, archive), (second, _) = searched(options), searched(options)
    assert [one.candidate.content for one in first] == [one.candidate.content for one in second]
    assert [one.candidate.weather for one in first] == [CLEAR] * 20
    assert archive.driven.total() == 20
    other, _ = searched(options_of("budget=20", f"sampler={sampler}", "seed=4"))
    assert other[0].candidate.content != first[0].candidate.content


def test_the_familys_sampler_draws_from_its_whole_ranges() -> None:
    drives, _ = searched(options_of("budget=24", "sampler=family"))
    for one in drives:
        assert one.candidate.parameters["radius"] == one.candidate.features["bend"]
    assert np.median([one.candidate.features["bend"] for one in drives]) < 25


def test_without_optuna_a_line_names_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(InputError, match=r"sampler=tpe: .*pip install 'drivezoo\[optuna\]'"):
        searched(options_of("budget=8", "sampler=tpe"))
