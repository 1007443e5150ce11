"""Figures of a group with their intervals."""

import math

import pytest

from zoo.benchmark.result import DriveRecord
from zoo.benchmark.summary import differences, group_figures, headline
from zoo.drives.interventions import INTERVENTION_S


def record(
    number: int,
    lost: int = 0,
    checkpoint: int = 0,
    error: float = 0.5,
    group: str = "like",
    settings: dict | None = None,
) -> DriveRecord:
    """Return a drive of 300 m in 60 s on road `number`."""
    figures = {
        "autonomy": max(0.0, 1 - INTERVENTION_S * lost / 60),
        "interventions": lost,
        "driven_m": 300.0,
        "driven_s": 60.0,
        "cte_mean_m": error,
        "steering_per_s": 0.3,
    }
    return DriveRecord(
        checkpoint=checkpoint,
        group=group,
        track=f"lakeside:{number}",
        settings=settings or {},
        figures=figures,
        digest="0" * 16,
    )


def test_counts_have_exact_intervals() -> None:
    figures = group_figures([record(one, lost=int(one == 0)) for one in range(3)])
    metres = figures["m_per_intervention"]
    assert metres.value == pytest.approx(900)
    assert (metres.low, metres.high) == pytest.approx((900 / 5.5716, 900 / 0.025318), rel=1e-3)
    kept = figures["without_intervention"]
    assert kept.value == pytest.approx(2 / 3)
    assert (kept.low, kept.high) == pytest.approx((0.2077, 0.9385), abs=1e-3)


def test_no_intervention_in_three_drives_is_never_a_bare_100_percent() -> None:
    drives = [record(one) for one in range(3)]
    figures = group_figures(drives)
    assert figures["autonomy"].value == 1
    assert figures["autonomy"].low == pytest.approx(1 - 6 * 3.689 / 180, abs=1e-3)
    assert figures["m_per_intervention"].value is None
    assert figures["m_per_intervention"].low == pytest.approx(900 / 3.689, rel=1e-3)
    assert figures["m_per_intervention"].high is None
    assert headline(drives).low == pytest.approx(1 - 6 * 3.689 / 90, abs=1e-3)


def test_the_headline_trims_roads_and_leaves_out_laps() -> None:
    lost = [0, 0, 1, 1, 2, 2, 9, 9]
    drives = [record(number, count) for number, count in enumerate(lost)]
    laps = [record(99, 10, group="laps")]
    # The middle half has 1, 1, 2 and 2 interventions.
    assert headline([*drives, *laps]).value == pytest.approx(0.85)


def test_a_roads_figure_is_its_mean_over_training_seeds() -> None:
    drives = [record(one, lost=seed, checkpoint=seed) for seed in (0, 1) for one in range(4)]
    found = headline(drives)
    assert found.value == pytest.approx(0.95)
    assert found.low < 0.95 < found.high


def test_shifted_drives_are_compared_with_their_partners() -> None:
    foggy = [
        record(one, 1, error=0.7, group="looks", settings={"weather": {"fog": 1}})
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
    assert (found.low, found.high) == (pytest.approx(-0.45, abs=0.2), 1.0)
