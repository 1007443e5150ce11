"""Repeating a run from its folder."""

import json
import re
from pathlib import Path
from unittest.mock import Mock

import pytest

from tests.recordings import Written
from tests.refusals import refusal
from tests.zoo.command_runs import only_line, run_here, train_in_fork
from tests.zoo.sweeps import write_run
from tests.zoo.training.test_sweep_command import SMALL
from zoo.base.errors import StoppedError
from zoo.base.run_command import run_command
from zoo.commands.rerun import _report, _train, differences, rerun
from zoo.commands.train import train_or_sweep as zoo


def test_a_run_is_repeated_to_the_digit(
    recorded: Written,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    """The current folder is another one, and the recording's path is relative."""
    monkeypatch.chdir(recorded.folder.parent)
    folder = tmp_path / "run"
    arguments = [
        *(setting for setting in SMALL if not setting.startswith(("model", "score"))),
        *("model=lenet", "score=lake", "score.laps=0.02", "score.quality=simple"),
        *("score.film=false", "data.root=lake", f"data.cache={tmp_path}/cache"),
        *("trainer.max_epochs=2", f"hydra.run.dir={folder}"),
    ]
    monkeypatch.setattr("sys.argv", ["zoo", *arguments])
    assert run_command("zoo", zoo, arguments) == 0
    metrics = json.loads((folder / "metrics.json").read_text())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("zoo.commands.rerun.run_module", Mock(side_effect=StoppedError))
    assert run_command("zoo.commands.rerun", rerun.main, ["run", "out=again"]) == 130
    assert f"drivezoo rerun run out={tmp_path / 'again'}" in capsys.readouterr().err
    monkeypatch.setattr("zoo.commands.rerun.run_module", train_in_fork)

    assert run_command("zoo.commands.rerun", rerun.main, ["run", "out=again"]) == 0

    out = capsys.readouterr().out
    assert "digit" in out
    assert "the code differs" not in out
    again = json.loads((tmp_path / "again" / "metrics.json").read_text())
    assert again["open_loop"] == metrics["open_loop"]
    assert again["drive"]["tracks"]["lake"]["cte_mean_m"] is not None
    changes, count = differences(metrics["open_loop"], again["open_loop"])
    assert (changes, count) == ([], 12)
    # The folder exists now: the command must not train again.
    assert run_command("zoo.commands.rerun", rerun.main, ["run", "out=again"]) == 1
    assert "out=" in capsys.readouterr().err


def test_differences_are_named_and_times_are_ignored() -> None:
    then = {"drive": {"lake": {"autonomy": [1.0, 0.0], "latency_ms": [2.0, 0.1]}}, "epochs": 3}
    now = {"drive": {"lake": {"autonomy": [0.9, 0.0], "latency_ms": [3.0, 0.1]}}, "epochs": 3}
    (change,), count = differences(then, now)
    assert change == ("drive.lake.autonomy.0", 1.0, 0.9)
    assert count == 3


@pytest.mark.parametrize(
    ("code", "named"),
    [
        ({"hash": "b2", "commit": "c3-dirty"}, True),
        ({"hash": "a1", "commit": "c3"}, False),
        (None, False),
    ],
)
def test_other_code_is_named(code: dict | None, named: bool, capsys: pytest.CaptureFixture) -> None:
    """The hash decides, not the commit."""
    now = {"versions": {}, "epochs": 3, "code": {"hash": "a1", "commit": None}}
    then = {"versions": {}, "epochs": 3} | ({"code": code} if code else {})
    _report(then, now, Path("out"))
    lines = [line for line in capsys.readouterr().out.splitlines() if "code" in line]
    assert len(lines) == named
    for line in lines:
        assert re.search(r"b2\b.*c3-dirty\b.*a1\b", line)


def test_the_training_gets_the_typed_parts_where_their_paths_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It prints the next commands."""
    ran = Mock(return_value=0)
    monkeypatch.setattr("zoo.commands.rerun.run_module", ran)
    monkeypatch.setattr("sys.orig_argv", ["drivezoo", "rerun", "run", "parts=my_net.py"])
    for place in (Path.cwd(), tmp_path):
        _train(Path("out"), place, (), None)
    assert ["parts=my_net.py" in call.args for call in ran.call_args_list] == [True, False]


@pytest.mark.parametrize("key", ["side_response", "choice", "train_samples"])
def test_every_figure_of_a_run_is_compared(key: str, capsys: pytest.CaptureFixture) -> None:
    code = {"hash": "a1", "commit": None}
    now = {"versions": {}, "epochs": 3, "code": code, key: {"test": 0.2}}
    assert "1 of 2 figures differ" in refusal(_report, now | {key: {"test": 0.1}}, now, Path("out"))
    assert f"{key}.test: 0.1 then, 0.2 now" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"), [(["nowhere"], "nowhere: "), (["run", "out=run"], "is not empty")]
)
def test_bad_input_gets_one_line(arguments: list[str], words: str, tmp_path: Path) -> None:
    write_run(tmp_path / "run")
    assert words in only_line(run_here(tmp_path, *arguments, module="zoo.commands.rerun"))
