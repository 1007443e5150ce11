"""A run's folder is enough to repeat it."""

import json
from pathlib import Path

import pytest

from tests.recordings import Written
from tests.zoo.sweep.test_sweep_command import SMALL
from tests.zoo.sweeps import write_run
from zoo.__main__ import zoo
from zoo.cli.run_command import run_command
from zoo.rerun import _report, differences, rerun


def test_a_run_is_repeated_to_the_digit_and_a_difference_is_told(
    recorded: Written,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    """From another folder, though its recording was named relative to where it was started."""
    monkeypatch.chdir(recorded.folder.parent)
    folder = tmp_path / "run"
    arguments = [
        *(one for one in SMALL if not one.startswith("model")),
        "model=lenet",
        "score=lake",
        "score.laps=0.02",
        "data.root=lake",
        f"data.cache={tmp_path}/cache",
        "trainer.max_epochs=2",
        f"hydra.run.dir={folder}",
    ]
    monkeypatch.setattr("sys.argv", ["zoo", *arguments])
    assert run_command("zoo", zoo, arguments) == 0
    metrics = json.loads((folder / "metrics.json").read_text())
    monkeypatch.chdir(tmp_path)
    capsys.readouterr()

    assert run_command("zoo.rerun", rerun, ["run", "out=again"]) == 0

    said = capsys.readouterr().out
    assert "to the digit" in said
    assert "the code differs" not in said
    again = json.loads((tmp_path / "again" / "metrics.json").read_text())
    assert again["open_loop"] == metrics["open_loop"]
    assert again["drive"]["tracks"]["lake"]["cte_mean_m"] is not None
    found, count = differences(metrics["open_loop"], again["open_loop"])
    assert (found, count) == ([], 12)
    # What stood in the way of that: none of it is trained again.
    assert run_command("zoo.rerun", rerun, ["run", "out=again"]) == 1
    assert "out=" in capsys.readouterr().err


def test_what_differs_is_named_and_times_are_not_compared() -> None:
    then = {"drive": {"lake": {"autonomy": [1.0, 0.0], "latency_ms": [2.0, 0.1]}}, "epochs": 3}
    now = {"drive": {"lake": {"autonomy": [0.9, 0.0], "latency_ms": [3.0, 0.1]}}, "epochs": 3}
    (found,), count = differences(then, now)
    assert (found.name, found.then, found.now) == ("drive.lake.autonomy.0", 1.0, 0.9)
    assert count == 3


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ({"hash": "b2", "commit": "c3-dirty"}, "the code differs: b2 (commit c3-dirty) then, a1 n"),
        ({"hash": "a1", "commit": "c3"}, None),
        (None, None),
    ],
)
def test_other_code_is_told_in_a_line(
    code: dict | None, said: str | None, capsys: pytest.CaptureFixture
) -> None:
    """Of which a commit is only a name; runs of before do not say."""
    now = {"versions": {}, "epochs": 3, "code": {"hash": "a1", "commit": None}}
    then = {"versions": {}, "epochs": 3} | ({"code": code} if code else {})
    _report(then, now, Path("out"))
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if "code" in line and said and line.startswith(said)] == [
        line for line in lines if "code" in line
    ]
    assert any("code" in line for line in lines) == bool(said)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "usage: python -m zoo.rerun RUN"),
        (["nowhere"], "nowhere: is no finished run's folder"),
        (["run", "in=x"], "in: no such key; "),
        (["run", "out=run"], "is not empty"),
    ],
)
def test_bad_input_gets_one_line(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_run(tmp_path / "run")
    assert run_command("zoo.rerun", rerun, arguments) in (1, 2)
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert words in line
