"""Scored drives, by policies without a camera in a world that is not rendered."""

from collections.abc import Callable

import numpy as np
import pytest

from tests.slow_members import slow
from tests.zoo.simulator.tracks import loop, open_road
from zoo.checkpoints.policy_base import Command
from zoo.driving.drive_loop import drive
from zoo.driving.drive_record import Drive
from zoo.driving.embedded_world import EmbeddedWorld
from zoo.driving.metrics import measure
from zoo.driving.open_world import open_world
from zoo.driving.scenario import Scenario
from zoo.driving.speed_controller import PI, Constant
from zoo.scoring.drive_plots import birds_eye
from zoo.scoring.track_scores import expert_steering_per_s
from zoo.simulator.expert import Expert
from zoo.simulator.simulated_world import World

AT_15 = Scenario("lake", laps=0.01)


@pytest.fixture
def lake() -> EmbeddedWorld:
    return open_world(Scenario("lake"), "none")


def straight_on(frame: np.ndarray | None, speed_mph: float) -> tuple[float, None]:
    return 0.0, None


def by_expert(world: World, spread: Callable[[float], float | None] = lambda _: None) -> Callable:
    """Return a policy that steers as the expert does, and whose spread depends on the distance."""
    expert = Expert(world.track)
    return lambda *_: Command(expert(world)[0], None, spread(world.place.distance))


def drive_straight_on(world: EmbeddedWorld, margin: float | None = None) -> Drive:
    return drive(straight_on, world, Scenario("lake", speed=20, margin=margin))


def test_a_policy_that_never_steers_is_put_back_at_every_bend(lake: EmbeddedWorld) -> None:
    driven = drive_straight_on(lake)
    figures = measure(driven)

    lost = np.flatnonzero(driven.intervention)
    assert len(lost) == figures["interventions"] > 10
    errors = driven.cross_track_m[lost]  # the bridge's wall holds the car before its edge line
    sides = {"left": sum(errors < -3.2), "right": sum(errors > 3.2), "wall": sum(abs(errors) < 3.2)}
    assert driven.infractions == {side: count for side, count in sides.items() if count}
    assert figures["laps"] == pytest.approx(1, abs=0.01)
    assert figures["m_per_intervention"] == pytest.approx(driven.driven_m / len(lost))
    before = driven.distance_m[lost, None] + np.linspace(-15, 0, 15)
    bends = lake.simulated.track.curvature_at(before).mean(1)
    assert (bends * errors > 0).all(), "straight on in a bend to the left is off to the right"
    # The edge line, or the bridge's wall, which holds the car before it.
    assert np.abs(errors).min() > lake.simulated.track.width / 2 - 0.31
    assert driven.cross_track_m[lost[:-1] + 1] == pytest.approx(0, abs=0.05)
    autonomy = max(0, 1 - 6 * len(lost) / driven.time_s[-1])
    assert figures["autonomy"] == pytest.approx(autonomy)


@pytest.mark.parametrize("speed", [2.0, 30.0])
def test_a_drive_on_the_spot_ends_after_five_times_the_time_of_its_speed(speed: float) -> None:
    world = open_world(Scenario("lake"), "none")
    circling = Scenario("lake", laps=0.02, speed=speed, margin=1000)
    driven = drive(lambda frame, mph: (1.0, None), world, circling)

    needed_s = 0.02 * world.simulated.track.length / (speed * 0.44704)
    assert driven.driven_m < 0.02 * world.simulated.track.length
    assert driven.time_s[-1] == pytest.approx(5 * needed_s, abs=0.2)


@pytest.mark.parametrize("track", ["lake", *slow("mountain", "udacity_lake", "udacity_mountain")])
def test_the_expert_drives_all_by_itself(track: str) -> None:
    scenario = Scenario(track, speed=20)
    world = open_world(scenario, "none")
    driven = drive(by_expert(world.simulated), world, scenario)
    figures = measure(driven)
    assert figures["autonomy"] == 1
    assert figures["interventions"] == 0
    assert figures["m_per_intervention"] == float("inf")
    assert figures["beyond_1m"] == 0
    assert len(driven.lap_s) == 1
    assert figures["speed_mph"] == pytest.approx(20, abs=1)
    assert figures["steering_per_s"] == expert_steering_per_s(scenario)


def test_a_car_that_stands_still_is_an_intervention_every_five_seconds() -> None:
    world, scenario = EmbeddedWorld(World(loop())), Scenario(laps=0.05, throttle="network")
    driven = drive(straight_on, world, scenario, speed=Constant(0.0))
    figures = measure(driven)
    assert figures["stalled"] == 1
    assert driven.time_s[driven.intervention][0] == pytest.approx(5.1, abs=0.1)
    assert figures["interventions"] == int(driven.time_s[-1] // 5)
    assert driven.infractions == {"standstill": figures["interventions"]}
    assert figures["autonomy"] == 0


@pytest.mark.parametrize("margin", [0.5, pytest.param(1.0, marks=pytest.mark.slow)])
def test_the_margin_is_where_it_was_set(lake: EmbeddedWorld, margin: float) -> None:
    driven = drive_straight_on(lake, margin)
    error = np.abs(driven.cross_track_m)
    lost = driven.intervention
    assert (lost == (error > margin)).all()
    assert error.max() < margin + 0.5, "a frame's way beyond it"
    assert lost.sum() > measure(drive_straight_on(lake))["interventions"]


def test_the_same_seed_gives_the_same_figures_and_another_seed_others(lake: EmbeddedWorld) -> None:
    drives = []
    for seed in (3, 3, 4):
        scenario = Scenario("lake", seed, laps=0.2, weather="random")
        figures = measure(drive(by_expert(lake.simulated), lake, scenario))
        drives.append({key: repr(v) for key, v in figures.items() if key != "latency_ms"})
    assert drives[0] == drives[1] != drives[2]


def test_frames_in_which_the_policy_steers_nan_are_counted(lake: EmbeddedWorld) -> None:
    driven = drive(lambda *_: (float("nan"), None), lake, AT_15)
    assert driven.nan_frames == len(driven.rows) > 5
    measured, straight = measure(driven), measure(drive(straight_on, lake, AT_15))
    assert str(measured.pop("lap_s")) == str(straight.pop("lap_s")) == "nan"
    assert measured == straight | {"latency_ms": measured["latency_ms"]}


def test_a_given_start_is_taken_and_the_driven_share_reported(lake: EmbeddedWorld) -> None:
    shares = []
    scenario = Scenario("lake", laps=0.05, start=300, offset=-1.0)
    driven = drive(straight_on, lake, scenario, report=shares.append)
    assert driven.distance_m[0] == pytest.approx(300, abs=0.1)
    assert driven.cross_track_m[0] == pytest.approx(-1, abs=0.02)
    assert len(shares) == len(driven.rows)
    assert shares == sorted(shares)
    assert shares[0] == 0
    assert 0.9 < shares[-1] <= 1


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("seed", [0, 3])
def test_every_seed_drives_the_whole_of_an_open_road(way: int, seed: int) -> None:
    world = World(open_road(), direction=way)
    driven = drive(by_expert(world), EmbeddedWorld(world), Scenario("road", seed, laps=2.0))
    figures = measure(driven)
    assert figures["laps"] == pytest.approx(1, abs=1e-6)
    assert len(driven.lap_s) == 1
    assert figures["interventions"] == 0
    assert driven.lap_s[0] == pytest.approx(world.track.length / (15 * 0.44704), abs=1.5)
    assert birds_eye(world.track, driven.xy, driven, "road").axes


def test_the_lane_is_as_wide_as_the_road_at_the_car() -> None:
    world = World(open_road(widths=[[0, 12], [40, 12], [60, 4]]))
    driven = drive(straight_on, EmbeddedWorld(world), Scenario("road"))
    lost = driven.intervention
    assert driven.lane_m == world.track.width / 2
    half = world.track.width_at(driven.distance_m[lost]) / 2
    assert np.abs(driven.cross_track_m[lost]) == pytest.approx(half, abs=0.3)
    assert lost.sum() > 2


def test_a_policy_that_doubts_is_compared_with_the_expert(lake: EmbeddedWorld) -> None:
    driven = drive(by_expert(lake.simulated, lambda _: 0.01), lake, Scenario("lake", 1, laps=0.1))
    assert (driven.spread == 0.01).all()
    assert measure(driven)["spread_coverage"] > 0.95
    straight = drive(straight_on, lake, Scenario("lake", 1, laps=0.02))
    assert np.isnan([straight.spread, straight.expert_steering]).all()


def test_the_speed_follows_the_doubt(lake: EmbeddedWorld) -> None:
    doubting = by_expert(lake.simulated, lambda distance: 0.3 if 200 < distance < 300 else 0.0)
    speed = PI(15, 0.1, 0.002, doubt_mph=6)
    driven = drive(doubting, lake, Scenario("lake", laps=0.4), speed=speed)
    within = (driven.distance_m > 230) & (driven.distance_m < 300)
    assert driven.speed_mph[within].mean() < 7
    assert driven.speed_mph[driven.distance_m < 200].mean() > 13
