"""`drivezoo compare A B` on results with known figures, and its statistics."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from tests.refusals import refusal
from tests.zoo.command_runs import only_line, run_here, succeed
from tests.zoo.results.synthetic_results import ROADS, figures, result, summed, write
from zoo.base.limits import MOST
from zoo.driving.clustered import p_value
from zoo.results.differences import (
    A_BETTER,
    B_BETTER,
    CANNOT_TELL,
    compare_entries,
    compare_roads,
    read_entries,
    seeds_needed,
)

# Autonomy of three trainings that differ by their seed alone.
VARIED = 0.6 + np.array([[-0.2], [0.0], [0.2]]) + np.zeros(len(ROADS))


def compare(cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    return run_here(cwd, *arguments, module="zoo.commands.compare")


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Return the folders of results A and B, B better by 0.2 with three training seeds each."""
    rng = np.random.default_rng(1)
    roads = 0.1 * rng.normal(size=len(ROADS))
    a = result(figures(rng, 0.6, 3, 0.01, roads), "published")
    b = result(figures(rng, 0.8, 3, 0.01, roads), "bends")
    return write(tmp_path / "a=[1]", a), write(tmp_path / "b", b)


def compared(cwd: Path, a: dict, b: dict, *keys: str) -> tuple[str, dict]:
    """Return what a comparison of two results prints, and its figures by group."""
    for name, content in (("a", a), ("b", b)):
        write(cwd / name, content)
    printed = succeed(compare(cwd, "a", "b", *keys))
    return printed, json.loads((cwd / "compare.json").read_text())["groups"]


def change(folder: Path, **fields: object) -> None:
    path = folder / "result.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | fields))


def test_the_better_entry_is_named(folders: tuple[Path, Path], tmp_path: Path) -> None:
    first, second = folders
    printed = succeed(compare(tmp_path, first.name, str(second / "result.json")))
    assert "verdict: B drives better" in printed
    assert "in 28 drives)" in printed, "of fewer roads"
    assert "wrote: compare.json" in printed
    written = json.loads((tmp_path / "compare.json").read_text())
    assert list(written["groups"]) == ["like", "sharp", "dynamics", "laps", "all but laps"]
    overall = written["groups"]["all but laps"]
    assert overall["roads"] == 28
    assert overall["difference"]["low"] < -0.2 < overall["difference"]["high"] < 0
    assert overall["p"] < 0.01
    assert overall["a_better"]["value"] < 0.05
    assert overall["verdict"] == "B drives better"
    assert overall["needed"] == {"seeds": None, "reason": "decided"}


def test_exchanged_entries_have_the_opposite_difference(folders: tuple[Path, Path]) -> None:
    change(folders[0], usual={})  # an older result
    exchanged = compare_entries(*read_entries(*folders[::-1]))
    for group, entry in compare_entries(*read_entries(*folders)).items():
        difference, better = exchanged[group].difference, exchanged[group].a_better
        assert entry.difference.value == pytest.approx(-difference.value)
        assert entry.a_better.value == pytest.approx(1 - better.value)


def test_the_order_of_the_drives_does_not_matter(folders: tuple[Path, Path]) -> None:
    before = repr(compare_entries(*read_entries(*folders)))  # with NaN, which equals nothing
    content = json.loads((folders[1] / "result.json").read_text())
    change(folders[1], **summed(content | {"drives": content["drives"][::-1]}))
    assert repr(compare_entries(*read_entries(*folders))) == before


def test_it_says_how_many_training_seeds_would_tell(tmp_path: Path) -> None:
    """Trainings differ much more than the entries."""
    shown, groups = compared(tmp_path, result(VARIED + 0.1), result(VARIED))
    assert "verdict: cannot tell" in shown
    needed = groups["like"]["needed"]
    assert needed["reason"] == "seeds"
    assert needed["seeds"] > 10
    assert f"about {needed['seeds']} training seeds" in shown


def test_paired_trainings_leave_out_what_their_seeds_share(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    a = np.clip(VARIED + 0.05 + 0.01 * rng.normal(size=VARIED.shape), 0, 1)
    shown, groups = compared(tmp_path, result(a), result(VARIED))
    assert "verdict: cannot tell" in shown
    shown = succeed(compare(tmp_path, "a", "b", "paired=true", "out=pairs.json"))
    assert "verdict: A drives better" in shown
    assert "paired: trainings of the same seed (0, 1, 2)" in shown
    alone = groups["all but laps"]["difference"]
    paired = json.loads((tmp_path / "pairs.json").read_text())["groups"]
    pairs = paired["all but laps"]["difference"]
    assert pairs["value"] == pytest.approx(alone["value"])
    # The t interval of three pairs' means, and of the roads, together.
    assert pairs["high"] - pairs["low"] < 0.2 * (alone["high"] - alone["low"])


def reseed(folder: Path, *seeds: int | None) -> None:
    checkpoints = json.loads((folder / "result.json").read_text())["checkpoints"]
    pairs = zip(checkpoints, seeds, strict=True)
    change(folder, checkpoints=[network | {"training_seed": seed} for network, seed in pairs])


def test_pairs_are_of_the_seeds_that_both_have(tmp_path: Path) -> None:
    scores = np.linspace(0.1, 0.9, 3)[:, None] + np.zeros(len(ROADS))
    shown, groups = compared(tmp_path, result(scores), result(scores[:2]), "paired=true")
    assert "paired: trainings of the same seed (0, 1)" in shown
    overall = groups["all but laps"]
    assert overall["difference"]["value"] == 0
    assert overall["a"] == overall["b"] == {"autonomy": pytest.approx(0.3)}
    reseed(tmp_path / "a", 1, 1, 2)
    first, *others = json.loads((tmp_path / "a/result.json").read_text())["checkpoints"]
    change(tmp_path / "a", checkpoints=[first | {"data": "of another recording"}, *others])
    shown = succeed(compare(tmp_path, "a", "b", "paired=true", "overwrite=true"))
    assert "paired: trainings of the same seed (1)" in shown, "a seed that stands twice"
    overall = json.loads((tmp_path / "compare.json").read_text())["groups"]["all but laps"]
    assert overall["a"] == {"autonomy": pytest.approx(0.3)}, "the mean of both trainings"


def test_one_pair_is_never_better(tmp_path: Path) -> None:
    for name, score in (("a", 1.0), ("b", 0.0)):
        write(tmp_path / name, result(np.full((3, len(ROADS)), score)))
    reseed(tmp_path / "b", 2, 3, 4)
    shown = succeed(compare(tmp_path, "a", "b", "paired=true"))
    assert "paired: trainings of the same seed (2)" in shown
    assert "verdict: cannot tell" in shown


@pytest.mark.parametrize(("seeds", "words"), [((0, 7), "0, b 7"), ((None, None), "none, b none")])
def test_pairs_need_a_shared_seed(tmp_path: Path, seeds: tuple, words: str) -> None:
    ones = np.ones((1, len(ROADS)))
    for name, seed in zip("ab", seeds, strict=True):
        write(tmp_path / name, result(ones))
        reseed(tmp_path / name, seed)
    line = only_line(compare(tmp_path, "a", "b", "paired=true"))
    assert f"a has the training seeds {words}; a pair is two trainings of one seed" in line


def test_roads_without_any_difference_are_no_proof_of_equality(tmp_path: Path) -> None:
    perfect = np.ones((3, len(ROADS)))
    shown, groups = compared(tmp_path, *(result(perfect, name) for name in "ab"))
    assert "both have the same score" in shown
    assert groups["like"]["difference"]["low"] < -0.2  # 0 of 12 roads: up to 24 %
    assert groups["laps"]["difference"]["low"] is None  # two tracks are too few


def test_many_roads_without_exception_decide_and_two_do_not(tmp_path: Path) -> None:
    clean = np.ones((3, len(ROADS)))
    _, groups = compared(tmp_path, result(clean), result(0 * clean))
    assert groups["like"]["verdict"] == "A drives better"
    assert groups["laps"]["verdict"] == "cannot tell"


def test_one_training_seed_says_nothing_about_other_trainings(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    autonomy = figures(rng, 0.6, 1, 0.0, 0.1 * rng.normal(size=len(ROADS)))
    shown, _ = compared(tmp_path, result(autonomy, "alone"), result(autonomy, "other"))
    assert "alone and other: one training seed" in shown
    assert "three or more training seeds, to estimate" in shown


def test_a_baseline_needs_no_further_training_seed(tmp_path: Path) -> None:
    expert = result(np.full((1, len(ROADS)), 0.7), "expert")
    expert["checkpoints"][0]["sha256"] = None
    shown, _ = compared(tmp_path, result(VARIED, "network"), expert)
    assert "a baseline" in shown
    assert "to estimate how many" not in shown
    written = json.loads((tmp_path / "compare.json").read_text())
    assert [written[side]["training_seeds"] for side in "ab"] == [3, 0]


def of_drives(change: Callable[[list[dict]], list[dict]]) -> Callable[[dict], dict]:
    """Return a change of a result's drives alone."""
    return lambda content: content | {"drives": change(content["drives"])}


def without_a_road(content: dict) -> dict:
    drives = [drive for drive in content["drives"] if drive["track"] != "alpine:703"]
    return summed(content | {"drives": drives})


AGAIN = "run the benchmark again"


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (lambda content: content | {"suite": "v9"}, ("suite", "v9", "own")),
        (lambda content: content | {"roads": "fedcba9876543210"}, ("roads", "fedcba9876543210")),
        (lambda content: content | {"usual": {"speed": 20.0}}, ("usual", "20.0", "15.0")),
        (of_drives(lambda _: []), ("drives", AGAIN)),
        (of_drives(lambda drives: drives[1:]), ("lakeside:501", "it once", AGAIN)),
        (of_drives(lambda drives: drives[:1] * (MOST["drives"] + 1)), ("5,001 drives",)),
        (
            of_drives(lambda drives: [drive for drive in drives if drive["group"] != "like"]),
            ("drive of lakeside:501 with", "group like"),
        ),
        (without_a_road, ("alpine:703", "which", AGAIN)),
    ],
)
def test_results_of_other_roads_or_with_wrong_drives_are_refused(
    folders: tuple[Path, Path], changed: Callable[[dict], dict], words: tuple[str, ...]
) -> None:
    first, second = folders
    path = second / "result.json"
    path.write_text(json.dumps(changed(json.loads(path.read_text()))))
    line = refusal(read_entries, first, second)
    assert all(word in line for word in (str(second), *words)), line


def test_what_has_no_result_or_not_all_roads_is_explained(
    folders: tuple[Path, Path], tmp_path: Path
) -> None:
    line = only_line(compare(tmp_path, str(folders[0]), str(tmp_path)))
    assert str(tmp_path / "result.json") in line
    line = only_line(compare(tmp_path, "lenet", str(folders[0])))
    assert line.startswith("drivezoo compare: lenet: no such file; drivezoo benchmark CKPT")
    assert "drivezoo leaderboard FOLDER" in line
    change(folders[0], suite="v1-quick")
    line = only_line(compare(tmp_path, *map(str, folders)))
    assert f"{folders[0] / 'result.json'}: roads: 0123456789abcdef" in line
    assert not (tmp_path / "compare.json").exists()


def test_no_input_or_foreign_file_is_replaced(folders: tuple[Path, Path], tmp_path: Path) -> None:
    arguments = [*map(str, folders)]
    keys = ("out=mine.json", "table=thesis.tex")
    paths = [tmp_path / key.partition("=")[2] for key in keys]
    for path in paths:
        path.write_text("mine")
    for key, words in (
        (f"out={folders[0]}/result.json", "is an input of this command"),
        *((key, "exists") for key in keys),
    ):
        line = only_line(compare(tmp_path, *arguments, key))
        assert f"{key}: {words}; name another file" in line
    assert {path.read_text() for path in paths} == {"mine"}
    succeed(compare(tmp_path, *arguments, *keys, "overwrite=true"))
    assert "mine" not in {path.read_text() for path in paths}


def test_a_name_or_a_narrow_terminal_spoils_no_figure(
    folders: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    change(folders[0], entry="[red]evil\x1b[2J")
    printed = succeed(compare(tmp_path, *map(str, folders)))
    assert "\x1b[2J" not in printed
    assert "[red]evil" in printed
    for shown in (printed, succeed(run_here(tmp_path, "models", module="zoo.commands.list"))):
        assert "…" not in shown


def drawn(
    rng: np.random.Generator, difference: float, seeds: int, by_seed: float, roads: int = 20
) -> tuple[np.ndarray, np.ndarray]:
    """Return the figures of A and B; A's mean is greater by `difference`, the roads vary it."""
    shared, of_roads = rng.normal(size=roads), 0.2 * rng.normal(size=roads)
    a, b = (
        by_seed * rng.normal(size=(seeds, 1)) + shared + 0.3 * rng.normal(size=(seeds, roads))
        for _ in range(2)
    )
    return a + of_roads + difference, b


def verdicts(difference: float, seeds: int, by_seed: float, repetitions: int = 300) -> list[str]:
    rng = np.random.default_rng(3)
    answers = []
    for _ in range(repetitions):
        a, b = drawn(rng, difference, seeds, by_seed)
        differences = a[:, None] - b[None]
        told = p_value(differences, range(a.shape[1]), [""] * a.shape[1]) < 0.05
        better = A_BETTER if differences.mean() > 0 else B_BETTER
        answers.append(better if told else CANNOT_TELL)
    return answers


@pytest.mark.parametrize("by_seed", [0.0, 0.5])
@pytest.mark.parametrize("seeds", [3, 6])
def test_equal_entries_are_seldom_told_apart(seeds: int, by_seed: float) -> None:
    answers = verdicts(0.0, seeds, by_seed)

    assert answers.count(CANNOT_TELL) / len(answers) > 0.92


def test_the_seeds_needed_decide_in_80_of_100_cases() -> None:
    # Five training seeds and 20 roads with exactly the variances of `drawn`.
    of_seeds, of_roads = np.array([-1, -1, 0, 1, 1]), np.linspace(-1, 1, 20)
    b = np.tile(of_seeds[:, None] * np.sqrt(0.5**2 + 0.3**2 / 20), 20)
    needed = seeds_needed(b + 0.2 * of_roads / of_roads.std(ddof=1) + 0.5, b)
    assert needed.reason == "seeds"

    answers = verdicts(0.5, needed.seeds, 0.5)
    assert 0.7 < answers.count(A_BETTER) / len(answers) < 0.9


def test_a_difference_that_roads_hide_needs_more_roads() -> None:
    of_roads = np.linspace(-1, 1, 8)[None].repeat(3, 0)
    assert seeds_needed(0.1 + of_roads, 0 * of_roads).reason == "roads"


def test_more_trainings_that_are_alike_tell_nothing_more() -> None:
    assert seeds_needed(np.ones((3, 4)), np.zeros((3, 4))).reason == "roads"


def test_no_number_is_given_for_a_tiny_difference() -> None:
    a = np.array([[-1.0], [0.0], [1.0]]).repeat(8, 1)
    assert seeds_needed(a + 0.01, a).reason == "many"


def test_the_probability_is_that_of_mann_and_whitney(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    a, b = (rng.integers(5, size=(seeds, len(ROADS))) / 4 for seeds in (6, 7))  # with equal values
    entries = [write(tmp_path / name, result(values)) for name, values in (("a", a), ("b", b))]
    roads = [road for road, (group, *_) in enumerate(ROADS) if group == "sharp"]
    shares = [stats.mannwhitneyu(a[:, road], b[:, road]).statistic / (6 * 7) for road in roads]

    comparison = compare_entries(*read_entries(*entries))["sharp"]

    assert comparison.a_better.value == pytest.approx(np.mean(shares))


def test_the_p_values_of_groups_are_corrected_for_their_number(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    drawn = [figures(rng, mean, 3, 0.01, np.zeros(len(ROADS))) for mean in (0.6, 0.62)]
    a, b = read_entries(*(write(tmp_path / f"{values.mean()}", result(values)) for values in drawn))
    together = compare_entries(a, b)
    roads = [road for road in a.drives if road.group == "sharp"]

    assert together["sharp"].p > compare_roads(a, b, roads).p
    assert together["laps"].p == 1  # two places


def test_one_training_is_never_better(tmp_path: Path) -> None:
    first = write(tmp_path / "a", result(np.ones((1, len(ROADS)))))
    second = write(tmp_path / "b", result(np.zeros((3, len(ROADS)))))
    comparison = compare_entries(*read_entries(first, second))["all but laps"]

    assert comparison.p < 0.05
    assert comparison.verdict == CANNOT_TELL
