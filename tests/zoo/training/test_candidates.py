"""Which checkpoint of a run becomes `best.ckpt`, and what the run prints of it."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from rich.console import Console

from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError
from zoo.base.process_pool import KilledProcessError
from zoo.checkpoints.checkpoint import read_checkpoint_file
from zoo.driving import run_drives
from zoo.scoring.track_scores import RunScore, run_options
from zoo.training import candidates
from zoo.training.candidates import choose_best, restore_monitored

SHORT = run_options(OmegaConf.create({"laps": 0.02, "candidate_laps": 0.02, "workers": 1}))
UNDRIVEN = run_options(OmegaConf.create({"candidate_laps": 0}))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Write a run whose monitored checkpoint, of epoch 1, leaves the road at once."""
    write_constant(tmp_path / "checkpoints" / "best.ckpt", steering=1.0, epoch=0)
    write_constant(tmp_path / "checkpoints" / "last.ckpt", steering=0.0, epoch=4)
    return tmp_path


def epoch(run: Path, name: str = "best") -> int:
    return read_checkpoint_file(run / "checkpoints" / f"{name}.ckpt")["epoch"] + 1


def test_the_better_driver_becomes_best(run: Path, console: Console) -> None:
    choice = choose_best(SHORT, "val/mse", run, console)

    assert choice["epoch"] == epoch(run) == 5
    assert epoch(run, "monitored") == 1, "the checkpoint with the lowest error is lost"
    assert [drive["file"] for drive in choice["drives"]] == ["last.ckpt", "best.ckpt"]
    assert choice["drives"][0]["interventions"] < choice["drives"][1]["interventions"]
    assert "best of 2 candidates" in choice["why"]
    printed = console.file.getvalue()
    assert "of zoo_lake each, from another start" in printed
    for words in ("epoch   1, lowest val/mse", "epoch   5, last epoch", "best.ckpt is of epoch 5"):
        assert words in printed

    restore_monitored(run)
    assert epoch(run) == 1, "training on compares with the lowest error again"
    assert not (run / "checkpoints" / "monitored.ckpt").exists()


def test_the_lowest_error_stays_where_it_drives_best(run: Path, console: Console) -> None:
    write_constant(run / "checkpoints" / "best.ckpt", steering=0.0, epoch=0)
    write_constant(run / "checkpoints" / "last.ckpt", steering=1.0, epoch=4)
    longer = replace(SHORT, candidate_laps=1.0)
    assert choose_best(longer, "val/mse", run, console)["epoch"] == epoch(run) == 1
    assert "0.02 laps of zoo_lake each, as score.laps, from another" in console.file.getvalue()
    assert not (run / "checkpoints" / "monitored.ckpt").exists()


def test_candidates_with_as_many_interventions_are_a_tie(run: Path, console: Console) -> None:
    write_constant(run / "checkpoints" / "best.ckpt", steering=0.001, epoch=0)
    write_constant(run / "checkpoints" / "last.ckpt", steering=0.0, epoch=4)
    choice = choose_best(SHORT, "val/mse", run, console)
    assert choice["drives"][0]["interventions"] == choice["drives"][1]["interventions"]
    assert "a tie: 2 of 2 candidates" in choice["why"]
    assert "best of" not in choice["why"]


@pytest.mark.parametrize(("quality", "drawn"), [("full", "fast"), ("simple", "simple")])
def test_candidates_drive_with_less_detail_far_away(
    quality: str, drawn: str, run: Path, console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def refuse(_: list, scenarios: list, *__: object) -> None:
        asked.extend(scenario.quality for scenario in scenarios)
        raise InputError("asked")

    monkeypatch.setattr(candidates, "all_drives", refuse)
    choose_best(replace(SHORT, quality=quality), "val/mse", run, console)
    assert asked == [drawn, drawn]


def test_what_drove_best_while_training_is_a_candidate(run: Path, console: Console) -> None:
    write_constant(run / "checkpoints" / "last.ckpt", steering=-1.0, epoch=4)
    write_constant(run / "checkpoints" / "driven.ckpt", steering=0.0, epoch=2)
    assert choose_best(SHORT, "val/mse", run, console)["epoch"] == epoch(run) == 3


@pytest.mark.parametrize(
    ("score", "monitor", "last_epoch", "words"),
    [
        (None, "val/mse", 4, "lowest val/mse.*score=none"),
        (UNDRIVEN, "val/mse", 4, r"lowest val/mse.*score\.candidate_laps=0"),
        (SHORT, "drive/score", 4, "best drive/score, by which a drive chose it"),
        (SHORT, "val/mse", 0, "lowest val/mse.*no other candidate"),
    ],
)
def test_what_needs_no_drive_is_not_driven_and_the_run_says_why(
    run: Path, console: Console, score: RunScore | None, monitor: str, last_epoch: int, words: str
) -> None:
    write_constant(run / "checkpoints" / "last.ckpt", steering=0.0, epoch=last_epoch)
    choice = choose_best(score, monitor, run, console)
    assert choice["epoch"] == epoch(run) == 1
    assert not choice["drives"]
    assert re.search(words, console.file.getvalue())


def test_without_a_simulator_the_lowest_error_stays_but_no_lack_of_memory_chooses(
    run: Path, console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = [InputError("no renderer opens"), KilledProcessError("a process was killed")]

    def fail(*_: object, **__: object) -> None:
        raise errors.pop()

    monkeypatch.setattr(run_drives, "open_world", fail)
    with pytest.raises(KilledProcessError):
        choose_best(SHORT, "val/mse", run, console)
    assert choose_best(SHORT, "val/mse", run, console)["epoch"] == epoch(run) == 1
    assert "no renderer opens" in console.file.getvalue()


def test_a_run_that_keeps_no_best_checkpoint_has_none(run: Path, console: Console) -> None:
    (run / "checkpoints" / "best.ckpt").unlink()
    assert choose_best(SHORT, None, run, console) is None
    assert not (run / "checkpoints" / "best.ckpt").exists()
