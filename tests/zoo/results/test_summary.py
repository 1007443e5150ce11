"""Figures of a group with their intervals."""

import math

import pytest

from zoo.driving.interventions import INTERVENTION_S
from zoo.results.result import DriveRecord
from zoo.results.summary import OVERALL, differences, group_figures, summarize_drives


def record(
    number: int,
    lost: int = 0,
    checkpoint: int = 0,
    error: float = 0.5,
    group: str = "like",
    settings: dict | None = None,
) -> DriveRecord:
    """Return a drive of 300 m in 60 s on road `number`."""
    figures = {"driven_m": 300.0, "driven_s": 60.0, "cte_mean_m": error, "steering_per_s": 0.3}
    figures |= {"autonomy": max(0.0, 1 - INTERVENTION_S * lost / 60), "interventions": lost}
    keys = {"group": group, "track": f"lakeside:{number}", "settings": settings or {}}
    return DriveRecord(checkpoint=checkpoint, figures=figures, digest="0" * 16, **keys)


def test_one_failure_in_three_drives_has_a_wide_interval() -> None:
    figures = group_figures([record(number, lost=int(number == 0)) for number in range(3)])
    rate, metres = figures["interventions_per_km"], figures["m_per_intervention"]
    assert rate.value == pytest.approx(1 / 0.9)
    assert rate.low < rate.value / 10
    assert rate.high > rate.value * 10
    assert metres.value == pytest.approx(900)
    assert (metres.low, metres.high) == pytest.approx((1000 / rate.high, 1000 / rate.low))
    clean = figures["without_intervention"]
    assert clean.value == pytest.approx(2 / 3)
    assert clean.low < 0.2
    assert clean.high > 0.9


def test_no_intervention_in_three_drives_is_never_a_bare_100_percent() -> None:
    """The exact bound: at most 71 % of the roads fail, each drive once."""
    figures = group_figures([record(number) for number in range(3)])
    assert figures["autonomy"].value == 1
    assert figures["autonomy"].low == pytest.approx(1 - 0.708 * 6 / 60, abs=1e-3)
    assert figures["without_intervention"].low == pytest.approx(0.292, abs=1e-3)
    assert figures["interventions_per_km"].high == pytest.approx(0.708 / 0.3, abs=1e-2)
    assert figures["m_per_intervention"].value is None
    assert figures["m_per_intervention"].low == pytest.approx(300 / 0.708, rel=1e-3)
    assert figures["m_per_intervention"].high is None


def test_laps_do_not_count_for_the_figures_of_all_roads() -> None:
    drives = [record(number, lost=1) for number in range(8)]
    groups = summarize_drives([*drives, record(99, 10, group="laps")]).groups
    assert groups[OVERALL] == groups["like"]
    assert groups["laps"]["autonomy"].value == 0
    assert OVERALL not in summarize_drives([record(99, group="laps")]).groups


def test_a_figure_is_the_mean_over_training_seeds() -> None:
    drives = [record(number, lost=seed, checkpoint=seed) for seed in (0, 1) for number in range(4)]
    autonomy = group_figures(drives)["autonomy"]
    assert autonomy.value == pytest.approx(0.95)
    assert autonomy.low < 0.95 < autonomy.high


def test_shifted_drives_are_compared_with_their_partners() -> None:
    foggy = [
        record(number, 1, error=0.6 + 0.1 * number, group="looks", settings={"weather": {"fog": 1}})
        for number in range(3)
    ]
    by_group = differences([*(record(number) for number in range(5)), *foggy])
    assert set(by_group) == {"looks"}
    assert by_group["looks"]["autonomy"].value == pytest.approx(-0.1)
    assert by_group["looks"]["cte_mean_m"].value == pytest.approx(0.2)
    assert not math.isnan(by_group["looks"]["cte_mean_m"].low)


@pytest.mark.parametrize("roads", [1, 2])
def test_fewer_than_three_roads_have_no_interval(roads: int) -> None:
    drives = [record(road, seed, seed) for seed in range(3) for road in range(roads)]
    shifted = [
        record(road, 3 * road, seed, group="looks", settings={"delay_s": 0.2})
        for seed in range(3)
        for road in range(roads)
    ]
    figures = [group_figures(drives), differences([*drives, *shifted])["looks"]]
    for figure in (figure for by_name in figures for figure in by_name.values()):
        assert (figure.low, figure.high) == (None, None)


def test_a_difference_of_shares_stays_between_minus_one_and_one() -> None:
    drives, late = [record(n, lost=10) for n in range(3)], {"delay_s": 0.2}
    shifted = [record(n, 10 if n else 0, group="looks", settings=late) for n in range(3)]
    change = differences([*drives, *shifted])["looks"]["autonomy"]
    assert change.value == pytest.approx(1 / 3)
    assert (change.low, change.high) == (-1.0, 1.0)
