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
    figures = group_figures([record(one, lost=int(one == 0)) for one in range(3)])
    rate, metres = figures["interventions_per_km"], figures["m_per_intervention"]
    assert rate.value == pytest.approx(1 / 0.9)
    assert rate.low < rate.value / 10
    assert rate.high > rate.value * 10
    assert metres.value == pytest.approx(900)
    assert (metres.low, metres.high) == pytest.approx((1000 / rate.high, 1000 / rate.low))
    kept = figures["without_intervention"]
    assert kept.value == pytest.approx(2 / 3)
    assert kept.low < 0.2
    assert kept.high > 0.9


def test_no_intervention_in_three_drives_is_never_a_bare_100_percent() -> None:
    """The exact bound: at most 71 % of the roads fail, each drive once."""
    figures = group_figures([record(one) for one in range(3)])
    assert figures["autonomy"].value == 1
    assert figures["autonomy"].low == pytest.approx(1 - 0.708 * 6 / 60, abs=1e-3)
    assert figures["without_intervention"].low == pytest.approx(0.292, abs=1e-3)
    assert figures["interventions_per_km"].high == pytest.approx(0.708 / 0.3, abs=1e-2)
    assert figures["m_per_intervention"].value is None
    assert figures["m_per_intervention"].low == pytest.approx(300 / 0.708, rel=1e-3)
    assert figures["m_per_intervention"].high is None


def test_laps_do_not_count_for_the_figures_of_all_roads() -> None:
    drives = [record(number, lost=1) for number in range(8)]
    found = summarize_drives([*drives, record(99, 10, group="laps")]).groups
    assert found[OVERALL] == found["like"]
    assert found["laps"]["autonomy"].value == 0
    assert OVERALL not in summarize_drives([record(99, group="laps")]).groups


def test_a_figure_is_the_mean_over_training_seeds() -> None:
    drives = [record(one, lost=seed, checkpoint=seed) for seed in (0, 1) for one in range(4)]
    found = group_figures(drives)["autonomy"]
    assert found.value == pytest.approx(0.95)
    assert found.low < 0.95 < found.high


def test_shifted_drives_are_compared_with_their_partners() -> None:
    foggy = [
        record(one, 1, error=0.6 + 0.1 * one, group="looks", settings={"weather": {"fog": 1}})
        for one in range(3)
    ]
    found = differences([*(record(one) for one in range(5)), *foggy])
    assert set(found) == {"looks"}
    assert found["looks"]["autonomy"].value == pytest.approx(-0.1)
    assert found["looks"]["cte_mean_m"].value == pytest.approx(0.2)
    assert not math.isnan(found["looks"]["cte_mean_m"].low)


@pytest.mark.parametrize("roads", [1, 2])
def test_fewer_than_three_roads_have_no_interval(roads: int) -> None:
    drives = [record(one, seed, seed) for seed in range(3) for one in range(roads)]
    shifted = [
        record(one, 3 * one, seed, group="looks", settings={"delay_s": 0.2})
        for seed in range(3)
        for one in range(roads)
    ]
    figures = [group_figures(drives), differences([*drives, *shifted])["looks"]]
    for one in (one for by_name in figures for one in by_name.values()):
        assert (one.low, one.high) == (None, None)


def test_a_difference_of_shares_stays_between_minus_one_and_one() -> None:
    drives = [record(one, lost=10) for one in range(3)]
    shifted = [
        record(one, 10 if one else 0, group="looks", settings={"delay_s": 0.2}) for one in range(3)
    ]
    found = differences([*drives, *shifted])["looks"]["autonomy"]
    assert found.value == pytest.approx(1 / 3)
    assert (found.low, found.high) == (-1.0, 1.0)
