"""Scored drives, by policies without a camera in a world that is not rendered."""

import numpy as np
import pytest

from simulator.expert import Expert
from simulator.world import Start, World, open_world
from tests.simulator.tracks import loop, open_road
from zoo.checkpoints.command import Command
from zoo.drives.drive_record import Drive
from zoo.drives.metrics import measure
from zoo.drives.speed_controller import Constant, Doubt
from zoo.evaluate.drive_plots import birds_eye
from zoo.evaluate.drives_table import mean_and_spread
from zoo.evaluate.embedded_drive import drive_closed_loop
from zoo.evaluate.many_drives import Setup, drive_setup, expert_steering_per_s, speed_controller


@pytest.fixture
def lake() -> World:
    return open_world("lake", renderer="none")


def straight_on(frame: np.ndarray | None, speed_mph: float) -> tuple[float, None]:
    return 0.0, None


def drive_straight_on(world: World, margin_m: float | None = None) -> Drive:
    return drive_closed_loop(straight_on, world, speed_controller(20), 0, 1, margin_m=margin_m)


def test_a_policy_that_never_steers_is_put_back_at_every_bend(lake: World) -> None:
    drive = drive_straight_on(lake)
    figures = measure(drive)

    lost = [number for number, row in enumerate(drive.rows) if row.intervention]
    assert len(lost) == figures["interventions"] > 10
    assert figures["laps"] == pytest.approx(1, abs=0.01)
    assert figures["m_per_intervention"] == pytest.approx(drive.driven_m / len(lost))
    for number in lost:
        bend = lake.track.curvature_at(drive.distance_m[number] + np.linspace(-15, 0, 15)).mean()
        error = drive.rows[number].cross_track_m
        assert bend * error > 0, "straight on in a bend to the left is off to the right"
    for number in lost[:-1]:
        # The edge line, or the bridge's wall, which holds the car before it.
        assert abs(drive.rows[number].cross_track_m) > lake.track.width / 2 - 0.31
        assert drive.rows[number + 1].cross_track_m == pytest.approx(0, abs=0.05)
    seconds = drive.rows[-1].time_s
    assert figures["autonomy"] == pytest.approx(max(0, 1 - 6 * len(lost) / seconds))


@pytest.mark.parametrize("track", ["lake", "mountain", "udacity_lake", "research_mountain"])
def test_the_expert_drives_all_by_itself(track: str) -> None:
    world = open_world(track, renderer="none")
    expert = Expert(world.track)
    drive = drive_setup(lambda *_: (expert(world)[0], None), world, Setup(track, speed_mph=20))
    figures = measure(drive)
    assert figures["autonomy"] == 1
    assert figures["interventions"] == 0
    assert figures["m_per_intervention"] == float("inf")
    assert figures["beyond_1m"] == 0
    assert len(drive.lap_s) == 1
    assert figures["speed_mph"] == pytest.approx(20, abs=1)
    assert figures["steering_per_s"] == expert_steering_per_s(Setup(track, speed_mph=20))


def test_a_car_that_stands_still_is_an_intervention_every_five_seconds() -> None:
    world = World(loop())
    drive = drive_closed_loop(straight_on, world, Constant(0.0), 0, 0.05)
    figures = measure(drive)
    assert figures["stalled"] == 1
    first = next(row.time_s for row in drive.rows if row.intervention)
    assert first == pytest.approx(5.1, abs=0.1)
    assert figures["interventions"] == int(drive.rows[-1].time_s // 5)
    assert figures["autonomy"] == 0


@pytest.mark.parametrize("margin", [0.5, 1.0])
def test_the_margin_is_where_it_was_set(lake: World, margin: float) -> None:
    drive = drive_straight_on(lake, margin)
    error = np.abs([row.cross_track_m for row in drive.rows])
    lost = np.array([row.intervention for row in drive.rows])
    assert (lost == (error > margin)).all()
    assert error.max() < margin + 0.5, "a frame's way beyond it"
    assert lost.sum() > measure(drive_straight_on(lake))["interventions"]


def test_the_same_seed_gives_the_same_figures_and_another_seed_others(lake: World) -> None:
    expert = Expert(lake.track)
    found = []
    for seed in (3, 3, 4):
        expert.reset(0)
        setup = Setup("lake", seed, laps=0.2, weather="random")
        figures = measure(drive_setup(lambda *_: (expert(lake)[0], None), lake, setup))
        found.append({key: repr(v) for key, v in figures.items() if key != "latency_ms"})
    assert found[0] == found[1] != found[2]


def test_a_start_of_ones_own_is_taken(lake: World) -> None:
    start = Start(300, cte=-1.0, speed_mph=15)
    drive = drive_closed_loop(straight_on, lake, speed_controller(15), 7, 0.01, start=start)
    assert drive.distance_m[0] == pytest.approx(300, abs=0.1)
    assert drive.rows[0].cross_track_m == pytest.approx(-1, abs=0.02)


def test_metres_per_intervention_are_of_all_drives_together() -> None:
    drives = [
        {"driven_m": 1000.0, "interventions": 0, "m_per_intervention": None},
        {"driven_m": 1000.0, "interventions": 4, "m_per_intervention": 250.0},
    ]
    assert mean_and_spread(drives)["m_per_intervention"] == (500.0, None)
    assert mean_and_spread(drives[:1])["m_per_intervention"] is None


def test_frames_in_which_the_policy_steers_nan_are_counted(lake: World) -> None:
    drive = drive_closed_loop(lambda *_: (float("nan"), None), lake, speed_controller(15), 0, 0.01)
    assert drive.nan_frames == len(drive.rows) > 5
    assert measure(drive) == measure(
        drive_closed_loop(straight_on, lake, speed_controller(15), 0, 0.01)
    ) | {"latency_ms": measure(drive)["latency_ms"]}


def test_how_much_is_driven_is_reported_at_every_frame(lake: World) -> None:
    shares = []
    drive = drive_closed_loop(
        straight_on, lake, speed_controller(15), 0, 0.05, report=shares.append
    )
    assert len(shares) == len(drive.rows)
    assert shares == sorted(shares)
    assert shares[0] == 0
    assert 0.9 < shares[-1] <= 1


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("seed", [0, 3])
def test_every_seed_drives_the_whole_of_an_open_road(way: int, seed: int) -> None:
    world = World(open_road(), direction=way)
    expert = Expert(world.track)
    drive = drive_setup(lambda *_: (expert(world)[0], None), world, Setup("road", seed, laps=2.0))
    figures = measure(drive)
    assert figures["laps"] == pytest.approx(1, abs=1e-6)
    assert len(drive.lap_s) == 1
    assert figures["interventions"] == 0
    assert drive.lap_s[0] == pytest.approx(world.track.length / (15 * 0.44704), abs=1.5)
    assert birds_eye(world.track, drive, "road").axes


def test_the_lane_is_as_wide_as_the_road_at_the_car() -> None:
    world = World(open_road(widths=[[0, 12], [40, 12], [60, 4]]))
    drive = drive_closed_loop(straight_on, world, speed_controller(15), 0, 1)
    lost = [number for number, row in enumerate(drive.rows) if row.intervention]
    assert drive.lane_m == world.track.width / 2
    for number in lost:
        half = world.track.width_at(drive.distance_m[number]) / 2
        assert abs(drive.rows[number].cross_track_m) == pytest.approx(half, abs=0.3)
    assert len(lost) > 2


def test_a_policy_that_doubts_is_compared_with_the_expert(lake: World) -> None:
    expert = Expert(lake.track)

    def doubting(frame: np.ndarray | None, speed_mph: float) -> Command:
        return Command(expert(lake)[0], None, 0.01)

    drive = drive_closed_loop(doubting, lake, speed_controller(15), 1, 0.1)
    figures = measure(drive)
    assert (drive.spread == 0.01).all()
    assert figures["spread_coverage"] > 0.95
    straight = drive_closed_loop(straight_on, lake, speed_controller(15), 1, 0.02)
    assert np.isnan([straight.spread, straight.expert_steering]).all()


def test_the_speed_follows_the_doubt(lake: World) -> None:
    expert = Expert(lake.track)

    def doubting(frame: np.ndarray | None, speed_mph: float) -> Command:
        return Command(expert(lake)[0], None, 0.3 if 200 < lake.place.distance < 300 else 0.0)

    speed = Doubt(15, 0.1, 0.002, doubt_mph=6, sure=0.05, unsure=0.2)
    drive = drive_closed_loop(doubting, lake, speed, 0, 0.4)
    within = (drive.distance_m > 230) & (drive.distance_m < 300)
    assert drive.speed_mph[within].mean() < 7
    assert drive.speed_mph[drive.distance_m < 200].mean() > 13
