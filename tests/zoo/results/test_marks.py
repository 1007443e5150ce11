"""The suites of the benchmark, which are frozen, and the pass marks of a course."""

import hashlib
import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.refusals import refusal
from tests.zoo.results import synthetic_results
from tests.zoo.results.test_benchmark_command import write_suite
from zoo.base.compose import conf_folder
from zoo.base.limits import MOST
from zoo.results.marks import marks_table, missed_line, reached_marks, verdict, write_marks
from zoo.results.result import BenchmarkResult, Interval
from zoo.results.suite import Marks, find_suite, read_suite
from zoo.results.summary import FIGURES, summarize_drives
from zoo.runs.page import hash_source

MARKS = {
    "like": {"autonomy": 0.9, "cte_mean_m": 0.8, "m_per_intervention": 500},
    "looks": {"autonomy": 0.7, "without_intervention": 0.5},
    "all but laps": {"autonomy": 0.8},
}


def marks_of(content: dict) -> dict[str, Marks]:
    return {group: Marks(**figures) for group, figures in content.items()}


def figure(value: float | None, low: float | None = 0.0, high: float | None = 1.0) -> dict:
    return {"value": value, "low": low, "high": high}


@pytest.fixture
def result() -> BenchmarkResult:
    """Return a result that reaches all marks but one, the autonomy of `looks`."""
    roads = (
        *(("like", f"lakeside:{number}", {}) for number in (802, 803)),
        ("looks", "lakeside:803", {"delay_s": 0.2}),
        ("looks", "lakeside:802", {"weather": {"fog": 0.5, "shadows": False}}),
    )
    content = synthetic_results.result(np.array([[1.0, 1.0, 0.9, 0.8]]), "<i>Ada's</i> net", roads)
    content["checkpoints"][0]["file"] = "my run/best.ckpt"
    rate = {"interventions_per_km": figure(0.1)}
    shared = rate | {"cte_mean_m": figure(0.5), "steering_per_s": figure(0.3)}
    like = {"autonomy": figure(0.9), "without_intervention": figure(1.0)}
    like |= {"interventions_per_km": figure(0.0), "m_per_intervention": figure(None, 400.0, None)}
    looks = {"autonomy": figure(0.65, 0.6, 0.7), "without_intervention": figure(0.5)}
    looks["m_per_intervention"] = figure(90.0)
    content["groups"] = {"like": shared | like, "looks": shared | looks}
    content["groups"]["all but laps"] = rate | {"autonomy": figure(0.81)}
    return BenchmarkResult.model_validate(content)


def test_a_figure_at_its_mark_passes_and_one_below_does_not(result: BenchmarkResult) -> None:
    reached = reached_marks(result, marks_of(MARKS))
    assert [(row.group, row.figure) for row in reached if not row.passed] == [("looks", "autonomy")]
    assert len(reached) == 6
    for text in ("1 of 6", "looks", "65.0", "at least 70.0"):
        assert text in missed_line(reached)


@pytest.mark.parametrize(
    ("interval", "status"),
    [
        ((0.9, 0.6, 1.0), "passed"),
        ((1 - 11 / 20 + 0.45, 0.6, 1.0), "passed"),  # a little less, by rounding
        ((0.8, 0.53, 0.99), "open"),
        ((0.8, 0.53, 0.85), "missed"),
        ((0.8, None, None), "missed"),
    ],
)
def test_a_mark_in_its_interval_is_open(
    result: BenchmarkResult, interval: tuple, status: str
) -> None:
    result.groups["like"]["autonomy"] = Interval(**figure(*interval))
    reached = reached_marks(result, marks_of({"like": {"autonomy": 0.9}}))
    assert (reached[0].status, verdict(reached)) == (status, status)
    assert ("drive more roads" in missed_line(reached)) == (status == "open")


@pytest.mark.parametrize(
    ("figure", "mark", "words"),
    [
        ("cte_mean_m", 0.5, ""),  # a lower error is better
        ("cte_mean_m", 0.49, "0.49"),
        ("m_per_intervention", 0, "unknown"),
    ],
)
def test_a_lower_error_passes_an_unknown_figure_not(
    result: BenchmarkResult, figure: str, mark: float, words: str
) -> None:
    unknown = Interval(value=None, low=None, high=None)
    result.groups["like"] |= dict.fromkeys(("interventions_per_km", "m_per_intervention"), unknown)
    (reached,) = reached_marks(result, marks_of({"like": {figure: mark}}))
    assert reached.passed == (not words)
    line = missed_line([reached])
    assert words in line
    assert bool(line) != reached.passed


@pytest.mark.parametrize(
    ("name", "reached", "mark", "shown"),
    [
        ("autonomy", 0.89968, 0.9, "89.968"),
        ("cte_mean_m", 0.5042, 0.5, "0.5042"),
        ("cte_mean_m", 0.4958, 0.5, "0.50"),
    ],
)
def test_no_missed_mark_seems_to_pass_by_its_rounding(
    result: BenchmarkResult, name: str, reached: float, mark: float, shown: str
) -> None:
    result.groups["like"][name] = Interval(**figure(reached, None, None))
    (rounded,) = reached_marks(result, marks_of({"like": {name: mark}}))
    assert rounded.texts[-1] == shown


def test_few_roads_without_an_intervention_reach_all_metres(result: BenchmarkResult) -> None:
    """Two roads have no intervals, so that the metres have no bound."""
    drives = [drive for drive in result.drives if drive.group == "like"]
    clean = result.model_copy(update=vars(summarize_drives(drives)))
    (reached,) = reached_marks(clean, marks_of({"like": {"m_per_intervention": 500}}))
    assert (reached.status, reached.texts[-1]) == ("passed", "none")


@pytest.mark.parametrize(
    ("marks", "fault"),
    [
        ([], "marks: should be keys and values"),
        ({}, "marks: "),
        ({"likes": {"autonomy": 0.9}}, "marks.likes: .*did you mean like"),
        ({"like": {"autonomie": 0.9}}, "marks.like.autonomie: no such key"),
        ({"like": {"autonomy": 90}}, "marks.like.autonomy: .*1"),
        ({"like": {"autonomy": True}}, "marks.like.autonomy: should be a number"),
        ({"headline": {"autonomy": 0.8}}, "marks.headline: "),
    ],
)
def test_wrong_marks_get_one_line(marks: object, fault: str, tmp_path: Path) -> None:
    path = write_suite(tmp_path, marks=marks)
    assert re.search(f"{re.escape(str(path))}: {fault}", refusal(read_suite, str(path)))


def test_the_suite_of_a_course_has_roads_of_its_own_and_marks_for_its_groups() -> None:
    files = ("suite/course.yaml", "suite/v1.yaml", "data/bench_v1.yaml")
    course, *others = (yaml.safe_load((conf_folder() / name).read_text()) for name in files)
    assert set(read_suite("course").marks) == {*course["groups"], "laps"}
    roads = tracks_in(course["groups"])
    assert len(roads) == sum(map(len, course["groups"].values()))
    for other in others:
        assert not roads & tracks_in(other)
    assert not roads & set(course["dev"])


def tracks_in(content: object) -> set[str]:
    """Return all values of the key `track` in a file."""
    if isinstance(content, dict):
        tracks = {content["track"]} if "track" in content else set()
        return tracks.union(*map(tracks_in, content.values()))
    return set().union(*map(tracks_in, content)) if isinstance(content, list) else set()


def test_an_autograder_and_a_student_get_files(result: BenchmarkResult, tmp_path: Path) -> None:
    reached = reached_marks(result, marks_of(MARKS))
    assert marks_table(reached).columns[-1].cells == 3 * ["passed"] + ["open"] + 2 * ["passed"]
    drives = [{"track": record.track} | record.settings for record in result.drives[2:]]
    path = str(write_suite(tmp_path, speed=28, groups={"like": [], "looks": drives}))
    graded, page = write_marks(tmp_path, result, reached, read_suite(path), path)
    content = json.loads(graded.read_text())
    assert not content["passed"]
    assert content["marks_passed"] == 5
    mark = {"group": "like", "figure": "autonomy", "value": 0.9}
    assert content["marks"][0] == mark | {"reached": 0.9, "passed": True, "status": "passed"}
    text = page.read_text()
    assert "5 of 6 marks reached" in text
    assert "<i>" not in text  # the entry's name is escaped
    style = re.search(r"<style>(.*?)</style>", text, re.DOTALL)[1]
    assert hash_source(style) in text.replace("&#39;", "'")
    assert "<script" not in text
    assert text.index("lakeside:802") < text.index("lakeside:803")  # the worst drive first
    command = "'my run/best.ckpt' track=lakeside:802 'weather={fog: 0.5, shadows: false}'"
    assert f"{command} speed=28.0 quality=simple film=true" in text.replace("&#39;", "'")
    assert f"drivezoo benchmark verify {tmp_path / 'result.json'} suite={path}" in text


def test_reached_marks_leave_no_worst_drives(result: BenchmarkResult, tmp_path: Path) -> None:
    reached = reached_marks(result, marks_of({"like": {"autonomy": 0.9}}))
    assert missed_line(reached) == ""
    graded, page = write_marks(tmp_path, result, reached, read_suite("quick"), "quick")
    assert json.loads(graded.read_text())["passed"]
    assert "Worst drives" not in page.read_text()


DIGESTS = {  # of the drawn roads, and of the names and settings of the drives
    "v1": ("b8f0de7e4cb5bb10", "a7a5168db3e8dbcf"),
    "quick": ("8f37ed4042b2ca79", "101722f58c26a9bf"),
    "latency": ("cfd5a8509447fba6", "9ca47358a6d079ba"),
}


@pytest.mark.parametrize("name", DIGESTS)
def test_a_suite_is_frozen(name: str) -> None:
    suite = read_suite(name)
    keys = hashlib.sha256(repr([tuple(row.key) for row in suite.drives]).encode()).hexdigest()[:16]
    assert (suite.roads, keys) == DIGESTS[name]


def test_v1_pairs_each_shifted_drive_with_a_clean_one() -> None:
    suite = read_suite("v1")
    counts = Counter(drive.group for drive in suite.drives)
    assert counts == {"like": 22, "sharp": 8, "looks": 8, "dynamics": 8, "laps": 2}
    clean = {drive.track for drive in suite.drives if drive.group == "like"}
    assert {drive.track for drive in suite.drives if drive.settings} <= clean
    assert len({drive.key for drive in suite.drives}) == len(suite.drives)


def test_quick_is_a_part_of_v1() -> None:
    keys = {drive.key for drive in read_suite("v1").drives}
    quick = read_suite("quick")
    assert quick.name == "v1-quick"
    assert {drive.key for drive in quick.drives} < keys


@pytest.mark.parametrize(
    ("name", "expected"),
    [("v1", ("v1", "test")), ("v1-dev", ("v1", "dev")), ("v1-quick", ("quick", "test"))],
)
def test_a_results_suite_is_found_by_its_name(name: str, expected: tuple[str, str]) -> None:
    assert find_suite(name, "v1") == expected


def test_a_suite_of_too_many_drives_is_refused_before_its_roads_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / "many.yaml"
    drives = [{"track": f"alpine:{number}"} for number in range(MOST["drives"] + 1)]
    path.write_text(json.dumps({"name": "many", "groups": {"like": drives}}))
    assert "many.yaml: groups: has 5,001 drives" in refusal(read_suite, str(path))


def test_large_figures_have_thousands_separators() -> None:
    assert FIGURES["interventions_per_km"].form.format(1234.5) == "1,234.50"
