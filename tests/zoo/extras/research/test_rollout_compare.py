"""`drivezoo compare` on rollouts of other programs, and its statistics."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import special

import drivezoo
from zoo.base.errors import InputError, UsageError
from zoo.driving.clustered import SHARE
from zoo.driving.intervals import share_interval
from zoo.extras.research.referee import Referee, needed_text
from zoo.extras.research.rollout_differences import (
    NEW,
    THESE,
    Difference,
    compare_policies,
    mean_score,
)
from zoo.extras.research.rollouts import Rollout

NORMAL = float(special.ndtri(0.975))
SCORES = np.arange(30.0).reshape(5, 6)


def rollouts(policy: str, won: np.ndarray, seeds: bool = True) -> list[Rollout]:
    """Return successes [scenes, seeds] as rollouts."""
    return [
        Rollout(policy, float(won[scene, seed]), f"scene {scene}", str(seed) if seeds else "")
        for scene, seed in np.ndindex(*won.shape)
    ]


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Return the interval of Wilson 1927, "Probable inference"."""
    share, square = successes / trials, NORMAL**2 / trials
    middle = (share + square / 2) / (1 + square)
    half = np.sqrt(share * (1 - share) / trials + square / trials / 4) * NORMAL / (1 + square)
    return middle - half, middle + half


def lerobot(path: Path, successes: list[list[int]]) -> Path:
    """Write what lerobot-eval 0.4 to 0.6 writes; a list for each task."""
    tasks = []
    for number, values in enumerate(successes):
        metrics = {"sum_rewards": [10.0 * value for value in values], "video_paths": []}
        metrics["max_rewards"] = [float(value) for value in values]
        metrics["successes"] = [bool(value) for value in values]
        tasks.append({"task_group": "suite", "task_id": number, "metrics": metrics})
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"per_task": tasks, "per_group": {}, "overall": {}}))
    return path


def bench2drive(path: Path, composed: dict[str, float]) -> Path:
    """Write what Bench2Drive's tools/merge_route_json.py writes; the score of each route."""
    records = [
        {
            "route_id": f"RouteScenario_{route}_rep0",
            "scenario_name": "ParkingExit_1",
            "status": "Completed" if score == 100 else "Failed",
            "infractions": {"red_light": [], "min_speed_infractions": ["slow"]},
            "scores": {"score_composed": score, "score_route": 100.0, "score_penalty": score / 100},
        }
        for route, score in composed.items()
    ]
    path.write_text(json.dumps({"_checkpoint": {"records": records}, "driving score": 1.0}))
    return path


def table(path: Path, rows: list[Rollout]) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["method", "task", "seed", "training_seed", "success"])
        writer.writerows([r.policy, r.scene, r.seed, r.training, r.score] for r in rows)
    return path


def compare_table(folder: Path, rows: list[Rollout], **options: object) -> Referee:
    """Compare the policies of one table."""
    file = table(folder / "r.csv", rows)
    return drivezoo.compare(file, policy="method", out=folder / "out.json", **options)


def differences(seeds: bool = True, **scores: np.ndarray) -> list[Difference]:
    """Return the differences of policies, given the scores [scenes, seeds] of each."""
    return compare_policies({name: rollouts(name, scores[name], seeds) for name in scores})


@pytest.fixture
def won() -> np.ndarray:
    """Return successes [policies, scenes, seeds] of two policies, the first clearly better."""
    rng = np.random.default_rng(3)
    return rng.random((2, 10, 10)) < np.array([0.9, 0.4])[:, None, None]


def test_policies_of_a_table_are_told_apart(tmp_path: Path, won: np.ndarray) -> None:
    result = compare_table(tmp_path, rollouts("act", won[0]) + rollouts("pi", won[1]))
    assert [row.verdict for row in result.differences] == ["act is better"] * 2
    figure = json.loads((tmp_path / "out.json").read_text())["differences"][1]["figure"]
    assert figure["value"] == pytest.approx(won[0].mean() - won[1].mean())
    assert figure["low"] < figure["value"] < figure["high"]
    assert "verdict: act, pi: act is better on these scenes, and on new scenes" in result.lines


def test_lerobots_file_tells_no_seeds(tmp_path: Path, won: np.ndarray) -> None:
    files = [lerobot(tmp_path / name / "eval_info.json", [*won[n]]) for n, name in enumerate("ab")]
    result = drivezoo.compare(*(file.parent for file in files), out=tmp_path / "out.json")
    assert any(line.startswith("seeds: none in") for line in result.lines)
    out = {"out": files[0].parent / "compare.json", "table": files[1].parent / "table.csv"}
    for again in (False, True):  # in the folders that it reads
        drivezoo.compare(*(file.parent for file in files), **out, overwrite=again)
    with pytest.raises(InputError, match="is an input of this command"):
        drivezoo.compare(files[0].parent, files[1], out=files[0], overwrite=True)
    pairs = drivezoo.compare(*files, same_seeds=True, out=tmp_path / "pairs.json")
    assert not any(line.startswith("seeds:") for line in pairs.lines)
    reward = drivezoo.compare(*files, score="sum_reward", out=tmp_path / "reward.json")
    assert reward.differences[0].figure.value > 1
    with pytest.raises(UsageError, match="score=reward"):
        drivezoo.compare(*files, score="reward", out=tmp_path / "none.json")


@pytest.mark.parametrize("ending", ["", ".0", "a"])
def test_seeds_that_no_two_policies_share_are_noted(ending: str, tmp_path: Path) -> None:
    won = np.tile([1, 0, 1, 1, 0], (3, 1))
    other = [replace(row, seed=row.seed + ending) for row in rollouts("b", won)]
    result = compare_table(tmp_path, rollouts("a", won) + other)
    assert any("rollouts are not paired" in line for line in result.lines) == (ending == "a")


def test_files_of_one_name_are_trainings(tmp_path: Path, won: np.ndarray) -> None:
    files = [lerobot(tmp_path / f"{n}.json", [*np.roll(won[n % 2], n)]) for n in range(4)]
    result = drivezoo.compare(*files, names="act,pi, act, pi", out=tmp_path / "out.json")
    assert list(result.policies) == ["act", "pi"]
    assert {row.training for row in result.policies["act"]} == {str(files[0]), str(files[2])}
    assert not any(line.startswith("trainings:") for line in result.lines)
    with pytest.raises(UsageError, match="names=act,pi,act,: needs a name for each of 4 files"):
        drivezoo.compare(*files, names="act,pi,act,", out=tmp_path / "no.json")


def test_one_name_is_not_that_of_several_policies(tmp_path: Path) -> None:
    several, single = tmp_path / "several.csv", tmp_path / "single.csv"
    several.write_text("policy,success\na,1\nb,0\na,0\n")
    single.write_text("policy,success\nc,1\nc,0\n")
    with pytest.raises(UsageError, match=r"names=x,y: .*several\.csv has 2 policies, a first"):
        drivezoo.compare(several, single, names="x,y", out=tmp_path / "out.json")


def test_a_file_counts_once(tmp_path: Path, won: np.ndarray) -> None:
    file = lerobot(tmp_path / "a" / "eval_info.json", list(won[0]))
    other = lerobot(tmp_path / "b" / "eval_info.json", list(won[1]))
    copy = lerobot(tmp_path / "copy.json", list(won[0]))
    for names, again in (("act,act,pi", file), (None, file), ("act,act,pi", copy)):
        with pytest.raises(InputError, match=f"{again}: is named twice, or a copy"):
            drivezoo.compare(file.parent, again, other, names=names, out=tmp_path / "out.json")


def test_a_scene_counts_alike_in_each_policy(tmp_path: Path) -> None:
    won = np.repeat([[1, 1, 1, 1, 0], [0, 0, 0, 0, 1]], 2, axis=0)
    rows = rollouts("easy", won) + rollouts("hard", won)
    rows += 3 * [row for row in rows if (row.policy == "easy") == (row.scene < "scene 2")]
    result = compare_table(tmp_path, rows)
    assert [row.figure.value for row in result.differences] == pytest.approx([0, 0])
    assert result.policy_table().columns[-1].figures["success"] == pytest.approx([0.5, 0.5])


def test_paired_trainings_are_compared_on_the_scenes_that_they_share(tmp_path: Path) -> None:
    won = np.tile([1, 0, 1, 1, 0], (3, 1))
    a = [replace(row, training=str(n)) for n in range(2) for row in rollouts("a", won)]
    b = [row for row in a if (row.scene, row.training) != ("scene 2", "0")]
    b = [replace(row, training=row.training.replace("1", "2"), policy="b") for row in b]
    result = compare_table(tmp_path, a + b, paired=True)
    for rows in result.policies.values():
        assert {(row.scene, row.training) for row in rows} == {("scene 0", "0"), ("scene 1", "0")}
    left = " left out, which not every policy has"
    assert result.notes[:2] == [f"1 scene{left}", f"2 trainings{left}"]
    extra = [replace(row, scene="scene 3") for row in a if row.scene == "scene 0"]
    # One scene is left out in each of two passes.
    result = compare_table(tmp_path, a + extra + b, paired=True, overwrite=True)
    assert result.notes[0] == f"2 scenes{left}"


def test_bench2drives_routes_are_scenes(tmp_path: Path) -> None:
    a = bench2drive(tmp_path / "a.json", {str(n): 100.0 for n in range(8)})
    b = bench2drive(tmp_path / "b.json", {str(n): 50.0 for n in range(1, 9)})
    result = drivezoo.compare(a, b, out=tmp_path / "out.json")
    assert result.differences[0].figure.value == 1
    assert any("2 scenes left out" in line for line in result.lines)
    assert any("divide by 220" in line for line in result.lines)
    assert any(line.startswith("rollouts: fewer than 5") for line in result.lines)
    these, new = result.differences
    assert these.figure == new.figure
    for name in ("score_composed", "score_penalty"):
        score = drivezoo.compare(a, b, score=name, out=tmp_path / f"{name}.json")
        assert score.differences[1].figure.value == pytest.approx(0.5)


def test_the_verdict_may_not_survive_new_scenes() -> None:
    won = np.zeros((2, 4, 25))
    won[0, :2], won[1, 3:] = 1, 1  # A wins two scenes, B another
    these, new = differences(a=won[0], b=won[1])
    assert (these.scope, these.verdict) == (THESE, "a is better")
    assert (new.scope, new.verdict) == (NEW, "not told apart")
    assert new.needed["scenes"] > 4
    assert new.needed["rollouts"] is None


def test_one_scene_says_nothing_of_new_ones() -> None:
    won = np.random.default_rng(2).random((2, 1, 40)) < np.array([0.9, 0.2])[:, None, None]
    these, new = differences(a=won[0], b=won[1])
    assert (these.verdict, new.verdict) == ("a is better", "unknown")


def test_pairs_take_fewer_rollouts_where_seeds_matter() -> None:
    rng = np.random.default_rng(0)
    b = rng.random((1, 60)) < 0.5
    a = b | (rng.random((1, 60)) < 0.2)
    paired, apart = (differences(seeds, a=a, b=b)[0].figure for seeds in (True, False))
    assert paired.value == pytest.approx(apart.value)
    assert paired.high - paired.low < apart.high - apart.low


def test_no_failure_has_the_exact_bound() -> None:
    won = rollouts("a", np.ones((5, 6)))
    figure = mean_score(won, THESE, SHARE)
    assert figure.high == 1
    assert figure.low == pytest.approx(share_interval(30, 30)[0])
    assert mean_score(won, NEW, SHARE).low == pytest.approx(share_interval(5, 5)[0])


def test_several_pairs_are_corrected(won: np.ndarray) -> None:
    third = differences(a=won[0], b=won[1], c=won[1])
    assert third[0].p > differences(a=won[0], b=won[1])[0].p
    assert len(third) == 6


def test_a_pair_that_only_the_correction_leaves_undecided_has_a_need() -> None:
    shares = np.array([0.75, 0.5, 0.5])[:, None, None]
    a, b, c = np.random.default_rng(9).random((3, 8, 6)) < shares
    pair = differences(a=a, b=b, c=c)[0]
    assert pair.verdict == "not told apart"
    assert pair.needed["rollouts"] > 6
    assert differences(a=a, b=b)[0].needed == {}, "a is better"


def test_the_need_does_not_depend_on_the_order_of_the_policies() -> None:
    many, few = np.tile([1, 1, 0, 1, 0], (4, 10)), np.tile([1, 0], (4, 3))
    these, _ = differences(seeds=False, many=many, few=few)
    turned, _ = differences(seeds=False, few=few, many=many)
    # (1.96 + 0.84)^2 (0.24 * 50 / 49 + 0.25 * 6 / 5) / 0.1^2 / 4 scenes; Student's t adds some.
    assert these.needed["rollouts"] == pytest.approx(107, rel=0.15)
    assert turned.needed == these.needed


def test_scenes_that_are_alike_tell_by_their_number_alone() -> None:
    _, new = differences(a=np.ones((5, 6)), b=np.zeros((5, 6)))
    assert new.needed == {"scenes": 6}, "p = 2 * (1 / 2) ** scenes"


def test_scores_that_are_no_successes_are_not_called_so(tmp_path: Path) -> None:
    (tmp_path / "scores.csv").write_text("policy,score\na,71.5\nb,60\n")
    drivezoo.compare(tmp_path / "scores.csv", out=tmp_path / "out.json")
    assert json.loads((tmp_path / "out.json").read_text())["score"] == "score"


def test_successes_are_not_compared_with_other_scores(tmp_path: Path) -> None:
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    files[0].write_text("success,reward\n1,50\n0,40\n")
    files[1].write_text("score,reward\n71.5,60\n0,30\n")
    for each in (files, files[::-1]):
        with pytest.raises(UsageError, match=r"a\.csv: has successes, .*b\.csv.*score=NAME"):
            drivezoo.compare(*each, out=tmp_path / "out.json")
    drivezoo.compare(*files, score="reward", out=tmp_path / "out.json")
    files[0].write_text("score\n1.0\n1.0\n")  # of the same scale as b.csv
    drivezoo.compare(*files, out=tmp_path / "scores.json")


def test_a_policy_that_scored_0_has_no_interval_where_another_scored_more(tmp_path: Path) -> None:
    scored = {"none": 0 * SCORES, "half": 0 * SCORES + 0.5, "more": SCORES}
    rows = [row for name, scores in scored.items() for row in rollouts(name, scores)]
    file = table(tmp_path / "r.csv", rows)
    file.write_text(file.read_text().replace("success", "score"))
    result = drivezoo.compare(file, policy="method", out=tmp_path / "out.json")
    lows = result.policy_table().columns[-1].figures["score_low"]
    assert [low is None for low in lows] == [True, True, False]
    assert [row.verdict == "unknown" for row in result.differences[:3]] == [True, False, False]


@pytest.mark.parametrize(
    ("apart", "count", "text"),
    [
        (0.0, 10, "both have the same score"),
        (1.0, 10, "rollouts that vary"),
        (1.0, 2, "three or more rollouts, to estimate how many"),
    ],
)
def test_more_rollouts_are_wanted_only_of_too_few(apart: float, count: int, text: str) -> None:
    scores = np.arange(2.0, 2 + count)[None]
    these, _ = differences(a=scores, b=scores + apart)
    assert (these.verdict, needed_text(these)) == ("unknown", text)


def test_one_rollout_a_scene_does_not_tell_how_many_are_needed() -> None:
    a, b = np.random.default_rng(0).random((2, 30, 1)) < 0.5
    these, new = differences(a=a, b=b)
    assert (these.verdict, new.verdict) == ("not told apart", "not told apart")
    assert needed_text(these) == "5 or more rollouts in each scene, to estimate how many"
    assert list(new.needed) == ["scenes"]


def test_an_interval_without_scenes_is_as_wide_as_wilsons() -> None:
    won = np.random.default_rng(1).random((1, 100)) < 0.7
    figure = mean_score(rollouts("a", won), THESE, SHARE)
    low, high = wilson(int(won.sum()), won.size)
    assert (figure.low, figure.high) == pytest.approx((low, high), abs=0.01)


@pytest.mark.parametrize("separator", [",", ";", "\t", ", ", " ,"])
def test_a_spreadsheets_separators_are_known(tmp_path: Path, separator: str) -> None:
    lines = ["", "policy,success,note", "a,1,x", ",,", "b,0", ""]
    text = "\n".join(lines).replace(",", separator)
    (tmp_path / "r.csv").write_text(text, encoding="utf-8-sig")
    result = drivezoo.compare(tmp_path / "r.csv", out=tmp_path / "out.json")
    scores = {name: [row.score for row in rows] for name, rows in result.policies.items()}
    assert scores == {"a": [1.0], "b": [0.0]}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("policy,success\na,1\n", "one policy alone"),
        ("policy,success\na,1\nb,0\n,1\n", "line 4: column policy is empty; name the policy"),
        ("policy,success\n\na,1\n\nb,maybe\n", "line 5.*is no score"),
        ("policy;score\na;0,5\nb;1\n", r"line 2: '0,5' is no score; write 0, 1 or 0\.5"),
        ("policy,success\na,2\nb,1\n", "line 2: success is 2, not 0 or 1"),
        ("policy,won\na,1\nb,0\n", "has no column success or score; name another with score="),
        ("policy,score\na,0.5\nb,0,5\n", r"line 3: has more cells than the header; write 0\.5"),
        ("policy,success,success\na,1,0\nb,0,0\n", "has the column success twice; rename"),
        ("policy,success\nStra\xdfe,1\nb,0\n", "is no CSV in UTF-8.*save it again"),
    ],
)
def test_a_table_that_does_not_fit_is_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "r.csv").write_text(text, encoding="cp1252")
    with pytest.raises(InputError, match=message):
        drivezoo.compare(tmp_path / "r.csv", out=tmp_path / "out.json")


def test_numbers_in_a_json_table_are_names(tmp_path: Path, won: np.ndarray) -> None:
    rows = [
        {"policy": policy, "scene": [scene], "seed": seed, "training": None, "success": bool(value)}
        for (policy, scene, seed), value in np.ndenumerate(won)
    ]
    (tmp_path / "r.json").write_text(json.dumps(rows))
    result = drivezoo.compare(tmp_path / "r.json", out=tmp_path / "out.json")
    assert result.policies["0"][0] == Rollout("0", float(won[0, 0, 0]), "[0]", "0")
    assert not any(line.startswith("seeds:") for line in result.lines)


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "eval_info.json"
    (tmp_path / "folder").mkdir()
    path.write_text('{"per_task": [{"task_group": "a"}]}')
    with pytest.raises(InputError, match="not as LeRobot writes it"):
        drivezoo.compare(path, path, out=tmp_path / "out.json")
    path.write_text('{"other": 1}')
    with pytest.raises(InputError, match="known are: Bench2Drive, LeRobot, table"):
        drivezoo.compare(path, path, out=tmp_path / "out.json")
    with pytest.raises(InputError, match=r"has no eval_info\.json or merged\.json; name a file"):
        drivezoo.compare(tmp_path / "folder", path, out=tmp_path / "out.json")
    path.write_text('[{"policy": "a", "success": "maybe"}]')
    with pytest.raises(InputError, match=r"json: rollout 1: 'maybe' is no score"):
        drivezoo.compare(path, out=tmp_path / "out.json")
