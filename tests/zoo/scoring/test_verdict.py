"""The verdict: its level from the drives, its causes and its next commands."""

import json
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from tests.zoo.command_runs import run_here, succeed
from tests.zoo.written_checkpoints import write_constant
from zoo.base.console_script import place_of
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.driving.intervals import ONE_TRACK
from zoo.results.scored import load_evaluation
from zoo.scoring.evidence import Evidence, has_rig, read_evidence, training_command
from zoo.scoring.verdict import Verdict, judge, print_verdict

OF_MOUNTAIN = {"record": {"passes": [{"track": "mountain"}]}}


def drive(interventions: int = 0, track: str = "lake", seed: int = 0, laps: float = 1.0) -> dict:
    autonomy = max(0.0, 1 - 6 * interventions / 180)
    figures = {"autonomy": autonomy, "interventions": interventions, "laps": laps}
    return {"track": track, "seed": seed} | figures


def words_of(verdict: Verdict) -> list[list[str]]:
    """Return the words of each command that a verdict proposes."""
    return [shlex.split(command) for _, command in verdict.commands]


def evidence(config: dict | None = None, overrides: tuple = (), **metrics: object) -> Evidence:
    return Evidence("run/checkpoints/best.ckpt", config or {}, metrics, overrides)


@pytest.mark.parametrize(
    ("drives", "level"),
    [
        ([drive()], "drives"),
        ([drive(3)], "almost"),
        ([drive(20)], "fails"),
        ([drive(), drive(20, "mountain")], "fails"),
        ([drive(laps=0.1)], "unknown"),
        ([drive() | {"autonomy": None}], "unknown"),
        ([], "unknown"),
    ],
)
def test_the_level_follows_from_the_drives(drives: list[dict], level: str) -> None:
    assert judge(drives, evidence()).level == level


def test_each_track_has_its_own_verdict_and_the_worst_comes_first() -> None:
    """Three clean laps of one track do not make up for twelve interventions on another."""
    laps = [drive(seed=seed) for seed in range(3)]
    verdict = judge([*laps, drive(3, "jungle"), drive(12, "mountain")], evidence())
    assert "mountain" in verdict.headline
    assert [line.partition(":")[0] for line in verdict.tracks] == ["mountain", "jungle", "lake"]
    assert ["not drive" in line for line in verdict.tracks] == [True, False, False]
    assert "nearly" not in " ".join([verdict.headline, *verdict.tracks])
    assert "mountain" in verdict.commands[-1][1]


def test_the_headline_names_the_tracks_that_are_as_bad_up_to_three() -> None:
    drives = [drive(20), drive(1, "jungle"), drive(25, "mountain")]
    assert judge(drives, evidence()).headline == "It does not drive zoo_mountain or zoo_lake."
    drives += [drive(28, "a"), drive(28, "b")]
    assert judge(drives, evidence()).headline.endswith("a or b or zoo_mountain or others.")


def test_clean_laps_of_the_track_that_chose_the_checkpoint_are_named_as_such() -> None:
    choice = {"drives": [{"file": "best.ckpt"}]}
    facts = evidence({"score": {"track": "zoo_lake,mountain"}}, choice=choice)
    verdict = judge([drive(), drive(0, "mountain")], facts)
    assert verdict.headline == (
        "It drove 2 of 2 laps of zoo_mountain and zoo_lake, the track that it was chosen on."
    )
    record = {"out": "expert", "passes": [{"track": "mountain"}]}
    for root, words in ((None, ", the track that it was trained on"), ("own", "")):
        facts = evidence({"data": {"root": root, "record": record}})
        headline = judge([drive(0, "mountain")], facts).headline
        assert headline == f"It drove 1 of 1 laps of zoo_mountain{words}."


@pytest.mark.parametrize(
    ("roads", "lost", "begin"),
    [
        (16, 0, "It drives: 16 of 16 roads"),
        (15, 0, "It drove 15 of 15 laps of"),
        (16, 9, "It does not drive lakeside:0."),
        (16, 1, "It drove, with interventions, lakeside:0."),
    ],
)
def test_it_drives_only_after_16_of_16_clean_roads(roads: int, lost: int, begin: str) -> None:
    drives = [drive(0 if road else lost, f"lakeside:{road}") for road in range(roads)]
    assert judge(drives, evidence()).headline.startswith(begin)
    # The track that chose the checkpoint does not count.
    facts = evidence({"score": {"track": "lakeside:1"}}, choice={"drives": [{}]})
    assert "It drives" not in judge(drives, facts).headline


def test_a_line_of_a_track_has_each_comma_once() -> None:
    (line,) = judge([drive(1)], evidence()).tracks
    assert line.startswith("lake: drove, with interventions, autonomy ")


def test_an_autonomy_that_is_not_measured_is_not_printed_as_0() -> None:
    (line,) = judge([drive(1) | {"autonomy": None}], evidence()).tracks
    assert line == "lake: unknown, interventions: 1 in 1.00 laps"


def test_a_network_of_another_car_gets_no_verdict_by_driving() -> None:
    facts = replace(evidence({"data": {"root": "my laps"}}, ("quick=true",)), source="donkeycar")
    verdict = judge([drive(20)], facts)
    assert (verdict.level, verdict.causes) == ("unknown", ())
    assert "donkeycar" in verdict.certainty
    assert [words[:2] for words in words_of(verdict)] == [["drivezoo", "replay"]]
    assert "my laps" in verdict.commands[0][1]


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({"rig": "my car", "speed_mph": 9.0}, "replay run/checkpoints/best.ckpt tub"),
        ({"rig": "my car", "speed_mph": 0.0}, "replay run/checkpoints/best.ckpt tub speed=9"),
        ({"rig": None, "speed_mph": 0.0}, "new rig my_car"),
        ({}, "replay run/checkpoints/best.ckpt tub"),  # a run of an earlier version
    ],
)
def test_the_next_command_for_another_car_is_complete(facts: dict, words: str) -> None:
    tub = evidence({"data": {"root": "tub"}}, data=facts)
    verdict = judge([], replace(tub, source="donkeycar", has_rig=has_rig(facts)))
    assert verdict.commands[0][1] == f"drivezoo {words}"


@pytest.mark.parametrize(
    ("interventions", "driven_s", "level"),
    [(0, 60.0, "drives"), (0, 20.0, "unknown"), (1, 90.0, "almost"), (9, 60.0, "fails")],
)
def test_a_replay_is_judged_by_its_seconds(interventions: int, driven_s: float, level: str) -> None:
    autonomy = max(0.0, 1 - 6 * interventions / driven_s)
    replay = {"track": "replay of tub", "autonomy": autonomy, "interventions": interventions}
    replay |= {"laps": None, "driven_s": driven_s}
    facts = evidence({"data": {"root": "my laps"}, "quick": True}, side_response={"test": 0.01})
    facts = replace(facts, source="donkeycar")
    verdict = judge([replay], facts, replayed="replay of 3 stretches")
    assert verdict.level == level
    assert "replay of 3 stretches" in verdict.certainty
    assert f"{driven_s:.0f} s" in verdict.tracks[0]
    assert "side cameras" not in " ".join(verdict.causes)
    assert words_of(verdict)[-1][1:] == ["replay", facts.checkpoint, "my laps"]


def test_the_next_command_names_a_track_as_the_user_typed_it() -> None:
    for lost in (0, 20):
        verdict = judge([drive(lost, "own")], evidence(), ["lake", "my roads/own.yaml"])
        assert words_of(verdict)[-1][-1].endswith("=my roads/own.yaml")
    facts = evidence({"score": {"track": "my_track.yaml,lake"}})
    assert "=my_track.yaml" in judge([drive(0, "my_track")], facts).commands[-1][1]


@pytest.mark.parametrize(("lost", "world"), [(0, "embedded"), (20, "embedded"), (0, "donkey")])
def test_the_next_command_drives_at_the_speed_that_was_driven(lost: int, world: str) -> None:
    for facts, speed in ((evidence(), 28.0), (evidence({"score": {"speed": 28}}), None)):
        driven = {"speed": speed} if speed else None
        command = judge([drive(lost)], facts, ["lake"], world, driven=driven).commands[-1][1]
        assert " speed=28" in command
    assert "speed=" not in judge([drive(lost)], evidence(), driven={"speed": 15.0}).commands[-1][1]


def test_the_next_command_drives_in_the_weather_that_was_driven() -> None:
    fog = {"weather": "{fog: 0.8}", "quality": "fast"}
    for facts, driven in ((evidence(), fog), (evidence({"score": fog}), None)):
        verdict = judge([drive(20)], facts, driven=driven)
        if place_of("correct"):  # an extra's
            assert words_of(verdict)[-1][-2:] == ["weather={fog: 0.8}", "quality=fast"]
            assert verdict.commands[-1][0] == "let the expert correct it", "no command before it"
        assert verdict.causes[0] == "It was driven in weather={fog: 0.8}."
        command = judge([drive(0)], facts, driven=driven).commands[-1][1]
        assert "weather" not in command, "drivezoo drive has clear weather alone"


def test_the_next_command_after_another_world_names_it() -> None:
    verdict = judge([drive(0, "Lake-v0")], evidence(), ["Lake-v0"], "gymnasium")
    why, command = verdict.commands[-1]
    assert why == "drive it three times", "a Donkeycar scene has one start for all seeds"
    assert "evaluate" in command
    assert "track=Lake-v0 world=gymnasium" in command


def test_start_seeds_of_one_track_have_a_count_and_no_interval() -> None:
    verdict = judge([drive(seed=seed) for seed in range(3)], evidence())
    assert "3 of 3 (tracks: 1, start seeds: 3, trainings: 1)" in verdict.certainty
    assert ONE_TRACK in verdict.certainty
    assert "%" not in " ".join([verdict.headline, verdict.certainty, *verdict.tracks])


@pytest.mark.parametrize(
    ("facts", "cause", "typed"),
    [
        (evidence({"quick": True}, ("quick=true", "seed=3")), "quick=true", "seed=3"),
        (
            evidence({}, ("model=nvidia",), side_response={"val": 0.2, "test": 0.01}),
            "side cameras",
            "data.offset=0.3",
        ),
        (
            evidence({"data": {"cameras": ["center"]}}, (), side_response={"test": 0.01}),
            "centre camera",
            "data.cameras=[center,left,right]",
        ),
        (
            evidence({}, ("quick=true",), train_samples=9_600, parameters=250_000, epochs=3),
            "9,600 samples",
            "trainer.max_epochs=16",
        ),
        (
            evidence({}, (), findings=[{"text": "84 % of steering is 0."}, {"text": "0 bends"}]),
            'The recording: 84 % of steering is 0. 0 bends. "augment=',
            "augment=[brightness,shadow,shift]",
        ),
        (evidence({"data": OF_MOUNTAIN}), "lake", "experiment=both_tracks"),
    ],
)
def test_a_likely_cause_is_named_with_a_remedy(facts: Evidence, cause: str, typed: str) -> None:
    verdict = judge([drive(20)], facts)
    assert cause in " ".join(verdict.causes)
    commands = words_of(verdict)
    assert commands[0][:2] == ["drivezoo", "train"]
    assert typed in commands[0]
    assert "quick=true" not in commands[0]
    if place_of("correct"):  # an extra's
        assert commands[-1][:3] == ["drivezoo", "correct", facts.checkpoint]
        assert verdict.commands[-1][0].startswith("or ")


def test_where_no_command_corrects_a_network_it_is_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zoo.scoring.verdict.place_of", lambda name: None)
    assert words_of(judge([drive(20)], evidence()))[-1][:2] == ["drivezoo", "drive"]


def test_the_command_against_the_causes_keeps_what_the_training_had() -> None:
    had = {"data": {"augment": {"shift": {}, "noise": {}}}, "quick": True}
    findings = [{"text": "no side cameras: an effect; set augment=[shift]"}]
    typed = ("experiment=lenet", "augment=[shift,noise]", "quick=true", "data.offset=0.3")
    command = words_of(judge([drive(20)], evidence(had, typed, findings=findings)))[0]
    assert command[2:4] == ["experiment=lenet", "data.offset=0.3"]
    assert command[4:] == ["augment=[shift,noise,brightness,shadow]"]


def test_a_remedy_that_the_training_had_is_not_advised_again() -> None:
    had = {"data": {"augment": {"brightness": {}, "shadow": {}, "shift": {}}}}
    findings = [{"text": "no side cameras: an effect; set augment=[shift]"}]
    facts = evidence(had, ("augment=[brightness,shadow,shift]",), findings=findings)
    verdict = judge([drive(20)], facts)
    assert "augment=" not in " ".join(verdict.causes)
    assert not any("train again" in purpose for purpose, _ in verdict.commands)


def test_the_recipe_for_unseen_roads_is_trained_on_the_same_recording() -> None:
    typed = ("experiment=lenet", "data.root=/my laps", "data.offset=0.3", "optim.lr=0.1")
    command = words_of(judge([drive(20)], evidence({"data": OF_MOUNTAIN}, typed)))[0]
    assert command == ["drivezoo", "train", "experiment=both_tracks", "data.root=/my laps"]


def test_the_recipe_is_not_advised_to_a_network_that_had_it() -> None:
    data = OF_MOUNTAIN | {"augment": {"pose": {"p": 0.7}}}
    verdict = judge([drive(20)], evidence({"data": data}))
    assert "do not show zoo_lake; record more roads" in " ".join(verdict.causes)
    assert not any("both_tracks" in command for _, command in verdict.commands)


def test_a_track_recorded_under_its_longer_name_is_a_track_it_has_seen() -> None:
    facts = evidence({"data": {"record": {"passes": [{"track": "zoo_lake"}]}}})
    assert "training images" not in " ".join(judge([drive(20, "lake")], facts).causes)


def test_a_network_that_drives_has_no_cause_and_is_told_how_sure_that_is() -> None:
    verdict = judge([drive()], evidence({"quick": True}))
    assert not verdict.causes
    assert [words[1] for words in words_of(verdict)] == ["benchmark", "drive"]


@pytest.mark.parametrize(
    "config", [{"data": 3}, {"data": {"crop": "x", "augment": 5}}, {"quick": []}]
)
def test_what_a_stranger_wrote_into_a_checkpoint_breaks_no_verdict(config: dict) -> None:
    facts = Evidence("a.ckpt", config, {"side_response": "x", "findings": 7, "epochs": {}}, None)
    assert judge([drive(20)], facts).level == "fails"


@pytest.mark.parametrize(
    ("typed", "changes", "shown"),
    [
        (
            ["experiment=lenet", "data.root='/a/b'", "quick=true"],
            {"quick": None, "augment": "[brightness]"},
            "experiment=lenet data.root=/a/b 'augment=[brightness]'",
        ),
        (["data.root='/a b'"], {}, "'data.root=/a b'"),
        (["data.root=['one','two laps']"], {}, "'data.root=[one,two laps]'"),
    ],
)
def test_the_command_repeats_what_was_typed(typed: list[str], changes: dict, shown: str) -> None:
    assert training_command(typed, changes) == f"drivezoo train {shown}"


@pytest.mark.parametrize("width", [60, 100, 200])
def test_the_box_fits_and_its_commands_stay_whole(width: int, console: Console) -> None:
    checkpoint = f"{'deep/' * 20}[/red]/best.ckpt"
    console.width = width
    print_verdict(judge([drive(20)], Evidence(checkpoint, {}, {}, None)), console)
    lines = console.file.getvalue().splitlines()
    assert any(shlex.quote(checkpoint) in line for line in lines)
    assert all(len(line) <= min(width, 100) for line in lines if line.startswith(("│", "╭", "╰")))


def test_an_evaluation_ends_with_the_verdict(tmp_path: Path) -> None:
    metrics = {"version": 1, "side_response": {"test": 0.01}}
    (tmp_path / "metrics.json").write_text(json.dumps(metrics))
    path = write_constant(tmp_path / "checkpoints" / "best.ckpt", steering=1.0)
    assert read_evidence(path, {}).metrics["side_response"] == {"test": 0.01}
    words = ("laps=0.05", "quality=simple", "offset=0.5", "start=9")
    printed = succeed(
        run_here(tmp_path, str(path), *words, "out=out", module="zoo.commands.evaluate")
    )
    settings = load_evaluation(tmp_path / "out").overrides
    assert settings == {"laps": "0.05", "offset": "0.5", "quality": "simple", "start": "9.0"}
    written = json.loads((tmp_path / "out" / "metrics.json").read_text())["verdict"]
    assert written["level"] == "fails"
    assert "It does not drive zoo_lake." in printed
    assert f"next: {written['commands'][-1][1]}" in printed.splitlines()


def test_a_file_that_only_drives_is_watched(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    path = write_constant(tmp_path / "left.ckpt", steering=-1.0)
    (tmp_path / "left.onnx").write_bytes(onnx_bytes(load_checkpoint(path)))
    words = ("left.onnx", "laps=0.01", "quality=simple", "out=out")
    printed = succeed(run_here(tmp_path, *words, module="zoo.commands.evaluate"))
    assert "next: drivezoo drive left.onnx sim=lake" in printed.splitlines()


def test_a_run_ends_with_the_verdict_and_its_report_begins_with_it(run_folder: Path) -> None:
    metrics = json.loads((run_folder / "metrics.json").read_text())
    assert "few_rows" in [finding["kind"] for finding in metrics["findings"]]
    verdict = metrics["verdict"]
    printed = (run_folder / "stdout.txt").read_text()
    page = (run_folder / "report" / "index.html").read_text()
    assert verdict["headline"] in printed
    assert verdict["commands"][0][1] in printed
    assert page.index('class="box') < page.index('class="tiles"')
    assert verdict["headline"] in page
    assert verdict["headline"] in (run_folder / "report" / "report.md").read_text()[:500]


@pytest.mark.parametrize(
    ("recorded", "typed", "name"),
    [
        ("lake", "lake", "zoo_lake"),
        ("lake", "zoo_lake", "zoo_lake"),
        ("udacity_lake", "udacity_lake", "udacity_lake"),
        ("lake.yaml", "roads/lake.yaml", "lake.yaml"),
    ],
)
def test_the_headline_names_which_lake_was_driven(recorded: str, typed: str, name: str) -> None:
    headline = judge([drive(12, recorded)], evidence(), [typed]).headline
    assert headline == f"It does not drive {name}."


def test_a_headline_that_is_longer_than_the_box_is_not_cut(console: Console) -> None:
    names = ("udacity_lake", "udacity_mountain", "udacity_jungle")
    verdict = judge([drive(0, name) for name in names], evidence())
    console.width = 80
    print_verdict(verdict, console)
    printed = " ".join(console.file.getvalue().replace("│", " ").split())
    assert verdict.headline in printed
