"""Roads of segments and surveys, widths and bridges, and one-line errors for wrong ones."""

import math
import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.zoo.simulator.tracks import LOOP, loop, open_road, refusal, write_track
from zoo.base.errors import InputError
from zoo.simulator.expert import Expert, ExpertSettings
from zoo.simulator.simulated_world import Start, World
from zoo.simulator.track import Track
from zoo.simulator.track_content import MOST_POINTS, TIGHTEST_RADIUS_M
from zoo.simulator.track_file import make_track, read_track

HEADER = "station_m,heading_deg,height_m\n"
OVAL = [
    {"straight": 80},
    {"left": 180, "radius": 40, "climb": 3},
    {"straight": 80},
    {"left": 180, "radius": 40, "climb": -3},
]
# Two loops, left and right; the second passes over the first one's start on a bridge.
EIGHT = [
    {"straight": 60},
    {"left": 270, "radius": 60, "climb": 8},
    {"straight": 120},
    {"right": 270, "radius": 60, "climb": -8},
    {"straight": 60},
]


def straights(count: int, metres: float) -> list[dict]:
    return [{"straight": metres} for _ in range(count)]


def circle(radius: float, step: float, height: float = 0.0) -> str:
    """Return a survey of a circle, driven anticlockwise."""
    count = round(2 * math.pi * radius / step)
    turn = 360 / count
    length = 2 * radius * math.sin(math.pi / count)
    return HEADER + "".join(
        f"{at * length:.3f},{(at + 0.5) * turn:.3f},{height * math.sin(at * turn / 57.3):.3f}\n"
        for at in range(count)
    )


def test_a_circle_may_be_one_segment():
    track = make_track("circle", {"segments": [{"left": 360, "radius": 50}]})
    assert track.length == pytest.approx(100 * math.pi, rel=1e-3)
    assert np.abs(track.curvature) == pytest.approx(1 / 50, rel=0.02)


def test_segments_have_their_lengths_radii_and_climbs():
    track = make_track("oval", {"segments": OVAL})
    assert track.closed
    assert track.length == pytest.approx(160 + 2 * math.pi * 40, abs=0.5)
    assert track.curvature_at(40) == pytest.approx(0, abs=1e-3)
    assert 1 / track.curvature_at(80 + 20 * math.pi) == pytest.approx(40, rel=0.01)
    assert track.curvature.max() < 1.01 / 40
    assert np.abs(np.diff(track.curvature)).max() < 0.004  # a transition, not a step
    assert track.grade_at(80 + 20 * math.pi) == pytest.approx(3 / (40 * math.pi), abs=1e-3)
    assert track.at(120 + 40 * math.pi)[2] == pytest.approx(3, abs=0.05)


def test_left_turns_left_and_right_turns_right():
    bend = [{"straight": 60}, {"right": 60, "radius": 30}]
    right = make_track("right", {"segments": bend, "closed": False})
    assert open_road().heading_at(110) == pytest.approx(math.radians(60), abs=0.01)
    assert right.heading_at(91) == pytest.approx(-math.radians(60), abs=0.03)
    assert right.curvature.min() == pytest.approx(-1 / 30, rel=0.02)


def test_an_open_road_may_be_given_by_points():
    road = make_track("road", {"points": LOOP[:4], "closed": False})
    assert road.at(0.0) == pytest.approx([0, 0, 0])
    assert road.at(road.length) == pytest.approx([100, 80, 0])
    straight = make_track("straight", {"points": [[0, 0, 0], [90, 0, 4.5]], "closed": False})
    assert straight.length == pytest.approx(90)
    assert straight.grade == pytest.approx(0.05)


def test_a_survey_may_be_an_open_road(tmp_path):
    road = read_track(write_track(tmp_path, circle(40, 10), closed=False))
    assert road.length == pytest.approx(240, abs=3)
    assert 1 / np.median(road.curvature) == pytest.approx(40, rel=0.05)
    closed = read_track(write_track(tmp_path, circle(40, 10, height=3.0)))
    assert closed.length == pytest.approx(251, abs=1)
    assert np.ptp(closed.xyz[:, 2]) == pytest.approx(6, abs=0.2)


def test_comments_and_blank_rows_of_a_survey_are_skipped(tmp_path):
    plain = read_track(write_track(tmp_path, circle(40, 10)))
    noted = "# a source\n\n" + circle(40, 10).replace("\n", "\r\n") + "\n# the end\n"
    assert read_track(write_track(tmp_path, noted)).length == plain.length


def test_widths_change_along_the_road():
    track = loop(widths=[[100, 10], [200, 6]])
    assert track.width_at(150.0) == pytest.approx(8, abs=0.05)
    assert track.width_at(10.0) == pytest.approx(8, abs=1)  # between 200 m and the next 100 m
    assert track.width_at(track.length) == track.width_at(0.0)
    assert track.width == pytest.approx(track.widths.mean())
    assert track.locate(*track.at(150.0)[:2], 150.0).width == pytest.approx(8, abs=0.05)
    assert loop(width=7.5, widths=[[100, 10]]).width == 7.5
    road = open_road(widths=[[50, 10], [100, 6]])
    assert (road.width_at(0.0), road.width_at(road.length)) == (10, 6)


def test_the_car_is_off_the_road_where_the_road_is_narrow():
    world = World(open_road(widths=[[0, 10], [50, 10], [60, 4]]))
    world.reset(0, Start(20, cte=3))
    assert not world.off_road
    world.put_back(Start(65, cte=3))
    assert world.off_road


def test_walls_stand_at_the_edge_of_the_width():
    world = World(open_road(widths=[[0, 10], [80, 5]], verge={"right": "wall", "left": "wall"}))
    expert = Expert(world.track, ExpertSettings(offset_m=1.0))
    with pytest.raises(InputError, match=r"-1\.5\.\.1\.5"):
        Expert(world.track, ExpertSettings(offset_m=2.0))
    while not world.is_complete(1):
        world.step(*expert(world))
        assert not world.at_wall
    world.put_back(Start(100, heading_deg=30, speed_mph=20))
    for _ in range(30):
        world.step(0.0, 0.5)
    assert world.at_wall
    assert abs(world.place.cte) == pytest.approx(2.5 + 0.7 - 1, abs=0.05)


@pytest.mark.parametrize("noise", [0, 1])
@pytest.mark.parametrize("way", [1, -1])
def test_the_expert_follows_bends_of_the_tightest_radius(way, noise):
    tight, straight = 1.01 * TIGHTEST_RADIUS_M, {"straight": 60}
    bends = [{"left": 180, "radius": tight}, {"straight": 20}, {"right": 180, "radius": tight}]
    content = {"segments": [straight, *bends, straight], "closed": False, "width": 5.6}
    track = make_track("bends", content)
    world = World(track, direction=way)
    expert = Expert(track, ExpertSettings(noise=noise, seed=2))
    while not world.is_complete(1):
        world.step(*expert(world))
        assert not world.off_road


def test_a_figure_of_eight_gets_a_bridge_over_its_lower_part():
    track: Track = make_track("eight", {"segments": EIGHT, "closed": True})
    upper = track.distance[track.bridge]
    crossing = track.at(float(upper.mean()))
    assert crossing[2] == pytest.approx(8, abs=0.5)
    assert crossing[:2] == pytest.approx(track.at(0.0)[:2], abs=1.5)
    assert np.ptp(upper) == pytest.approx(6.4 + 2 * 2.5 + 2 * 6 + 6.4, abs=4)
    flat = [{**segment, "climb": segment.get("climb", 0) / 4} for segment in EIGHT]
    with pytest.raises(InputError) as error:
        make_track("eight", {"segments": flat})
    assert "crosses itself" in str(error.value)
    assert "5 m of height for a bridge" in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"segments": OVAL, "points": LOOP}, "segments: points is given, too"),
        ({"survey": "mine.csv", "segments": OVAL}, "survey: segments is given, too"),
        ({"segments": []}, "segments: []; must have at least 1 item"),
        ({"segments": [{"up": 3}]}, "segments, number 1: unknown key up"),
        ({"segments": [{"left": 90}]}, "segments, number 1: must have straight"),
        ({"segments": [{"straight": 9, "radius": 9}]}, "number 1: must have straight"),
        ({"segments": [{"left": 9, "raduis": 9}]}, "did you mean radius"),
        ({"segments": [{"left": 90, "radius": 0}]}, "radius: 0; must be greater than or equal"),
        ({"segments": straights(9, 90000), "closed": False}, "extend over 810,000 m"),
        ({"segments": straights(MOST_POINTS + 1, 9)}, "segments: must have at most 10000 items"),
        ({"segments": [{"straight": 5}], "closed": False}, "5 m long; must be 20..100000 m"),
        ({"segments": [{"left": 3590, "radius": 9000}], "closed": False}, "is 563,916 m long; mu"),
        ({"segments": [{"straight": 99}, {"left": 90, "radius": 5}], "closed": False}, "the car"),
        ({"segments": OVAL[:3]}, "segments: the road ends 80.0 m from its start (east +0.0, n"),
        ({"segments": [*OVAL[:3], {"left": 180, "radius": 40}]}, "ends +3.0 m above its start"),
        ({"points": [[0, 0, 0]], "closed": False}, "1 points; an open road needs 2 or more"),
        ({"points": [[0, 0, 0], [0.2, 0, 0], [50, 0, 0]], "closed": False}, "less than 1 m apart"),
        ({"points": LOOP, "widths": []}, "widths: []; must have at least 1 item"),
        ({"points": LOOP, "widths": [[0, 2]]}, "widths, number 1, number 2: 2; must be"),
        ({"points": LOOP, "widths": [[0, 5], [9999, 6]]}, "widths, number 2: station 9999"),
        ({"points": LOOP, "widths": [[9, 5], [9, 6]]}, "station 9; stations must increase"),
        ({"points": LOOP, "widths": [[9, "5"]]}, "widths, number 1, number 2: 5; must be"),
        ({"survey": 7}, "survey: 7; must be a valid string"),
        ({"survey": "/etc/passwd"}, "survey: /etc/passwd; must be a .csv file in the folder"),
        ({"survey": "../mine.csv"}, "lies outside of the folder of this file"),
        ({"survey": "a\0b"}, "NUL"),
        ({"survey": "none.csv"}, "none.csv: cannot be read (No such file"),
        ({"survey": "."}, "no regular file"),
        ({"survey": "x" * 5000}, "File name too long"),
    ],
)
def test_a_mistake_is_one_line_with_the_file_and_the_key(tmp_path, content, message):
    assert message in refusal(write_track(tmp_path, **content))


def test_a_road_that_winds_up_a_thousand_times_is_refused_without_filling_memory():
    helix = [{"left": 3600, "radius": 10, "climb": 60} for _ in range(150)]
    with pytest.raises(InputError, match="segments: the road passes itself too often"):
        make_track("helix", {"segments": helix, "closed": False})
    helix = make_track("helix", {"segments": helix[:1], "closed": False})
    assert helix.bridge[round(70 / 0.5) :].all()
    assert not helix.bridge[: round(45 / 0.5)].any()


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("", "survey: mine.csv: the first row must be station_m,heading_deg,height_m"),
        ("station_m,heading\n1,2\n", "the first row must be station_m,heading_deg,height_m"),
        (HEADER, "survey: mine.csv: 0 rows; must have 4..10,000"),
        (HEADER + "0,0,0\n5,0\n", "survey: mine.csv: line 3: '5,0'; must be three numbers"),
        (HEADER + "0,0,0\n5,nan,0\n", "line 3: '5,nan,0'; must be three numbers"),
        (HEADER + "0,0,1e300\n", "line 2: '0,0,1e300'; must be three numbers"),
        (HEADER + "0,0,0\n9,0,0\n9.5,0,0\n20,0,0\n", "line 4: each station must be 1 m or more"),
        (HEADER + "".join(f"{at},0,0\n" for at in range(0, 100, 10)), "m from its start (east"),
        (HEADER + "".join(f"{2 * at},0,0\n" for at in range(MOST_POINTS + 1)), "10,001 rows"),
        (HEADER + "".join(f"{9000 * at},0,0\n" for at in range(9)), "extend over 76,500 m"),
        (HEADER + "0,0,0\n" * 200_000, "1,000,000"),
    ],
    ids=lambda text: text[-30:].replace("\n", " "),
)
def test_a_wrong_survey_is_one_line_with_the_row(tmp_path, rows, message):
    assert message in refusal(write_track(tmp_path, rows))


def test_a_survey_that_is_no_text_or_leads_out_of_the_folder_is_refused(tmp_path):
    (tmp_path / "mine.csv").write_bytes(b"\xff\xfe\x00\x01")
    path = write_track(tmp_path, survey="mine.csv")
    assert "mine.csv: byte 1 is not UTF-8; save it as UTF-8" in refusal(path)
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link.csv").symlink_to(tmp_path / "mine.csv")
    assert "lies outside" in refusal(write_track(inside, survey="link.csv"))
    (inside / "loop.csv").symlink_to("loop.csv")
    assert "survey" in refusal(write_track(inside, survey="loop.csv"))
    os.mkfifo(inside / "pipe.csv")
    assert "no regular file" in refusal(write_track(inside, survey="pipe.csv"))


def test_the_manuals_example_is_a_track_and_its_message_is_ours():
    page = (Path(__file__).parents[3] / "docs" / "simulator.md").read_text()
    text = page.partition("```yaml\nsegments:")[2].partition("```")[0]
    content = yaml.safe_load("segments:" + text)
    assert make_track("example", content).closed
    with pytest.raises(InputError) as error:
        make_track("example", {"segments": content["segments"][:3]})
    message = str(error.value).partition(":")[2].partition(": correct")[0]
    assert f"segments:{message}" in page
