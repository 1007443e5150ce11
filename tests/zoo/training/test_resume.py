"""Resuming a run: finished, moved, or trained by another process."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
import torch
from omegaconf import OmegaConf

from datamodules.balance import BalancedBatches, BatchKey
from tests.recordings import Written
from tests.zoo.commands import command, environment, run, succeed
from tests.zoo.sweeps import change_status
from tests.zoo.trainings import SMALL, data_of, zoo_here
from zoo.base.errors import InputError
from zoo.leaderboard.scored import read_scored
from zoo.runs.status import read_status, write_status

Zoo = Callable[..., int]


def weights(run_folder: Path, name: str) -> dict[str, torch.Tensor]:
    return torch.load(run_folder / "checkpoints" / f"{name}.ckpt", weights_only=True)["state_dict"]


def metrics(run_folder: Path) -> dict:
    return json.loads((run_folder / "metrics.json").read_text())


def times(folder: Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in [folder, *folder.rglob("*")]}


@pytest.fixture(scope="module")
def trained(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train for two epochs; tests copy the run."""
    cwd = tmp_path_factory.mktemp("trained")
    arguments = (*SMALL, *data_of(recorded))
    with pytest.MonkeyPatch.context() as monkeypatch:
        ended = zoo_here(monkeypatch, cwd, *arguments, "trainer.max_epochs=2", "hydra.run.dir=run")
    assert ended == 0
    return cwd / "run"


@pytest.fixture
def two_epochs(trained: Path, tmp_path: Path) -> Path:
    """Copy the finished run of two epochs for one test."""
    return Path(shutil.copytree(trained, tmp_path / "run"))


@pytest.fixture
def other_process() -> Iterator[int]:
    """Yield the number of a process that runs during the test."""
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    yield process.pid
    process.communicate()


def test_a_finished_run_is_left_as_it_is(
    two_epochs: Path, zoo: Zoo, capsys: pytest.CaptureFixture
) -> None:
    before = times(two_epochs)
    capsys.readouterr()
    for overrides in ([], ["trainer.max_epochs=2"]):
        assert zoo(f"resume={two_epochs}", *overrides) == 0
        said = capsys.readouterr()
        assert "after 2 epochs" in said.out
        assert str(two_epochs / "checkpoints" / "best.ckpt") in said.out
        assert str(two_epochs / "report" / "index.html") in said.out
        assert f"resume={two_epochs} trainer.max_epochs=4" in said.out
        assert said.err == ""
    assert times(two_epochs) == before


def test_more_epochs_train_a_finished_run_further(two_epochs: Path, zoo: Zoo) -> None:
    assert zoo("resume=run", "trainer.max_epochs=3") == 0
    assert metrics(two_epochs)["epochs"] == 3
    assert read_status(two_epochs)["status"] == "finished"
    config = OmegaConf.load(two_epochs / ".hydra" / "config.yaml")
    assert config.trainer.max_epochs == 3, "a run that is stopped again needs it"


def test_a_run_that_was_stopped_early_is_finished(
    two_epochs: Path, zoo: Zoo, capsys: pytest.CaptureFixture
) -> None:
    saved = two_epochs / ".hydra" / "config.yaml"
    config = OmegaConf.load(saved)
    config.trainer.max_epochs = 30
    config.callbacks.early_stopping = {"_target_": "lightning.pytorch.callbacks.EarlyStopping"}
    OmegaConf.save(config, saved)
    assert zoo("resume=run") == 0
    said = capsys.readouterr().out
    assert "after 2 epochs of 30" in said
    assert "resume=run callbacks.early_stopping=null" in said
    assert metrics(two_epochs)["epochs"] == 2


def test_a_finished_run_that_fails_to_train_further_keeps_its_figures_and_rank(
    two_epochs: Path, zoo: Zoo, capsys: pytest.CaptureFixture
) -> None:
    before = metrics(two_epochs)
    assert zoo("resume=run", "trainer.max_epochs=3", "optim.l2=0.1") == 1
    assert metrics(two_epochs) == before
    status = read_status(two_epochs)
    assert (status["status"], status["finished_epochs"]) == ("failed", 2)
    (run,), unranked = read_scored([two_epochs])
    assert (run.folder, unranked) == (two_epochs, [])
    assert zoo("resume=run", "trainer.max_epochs=3") == 0
    assert "finished_epochs" not in read_status(two_epochs)


def test_ctrl_c_while_training_further_names_the_figures_that_stand(
    two_epochs: Path, zoo: Zoo, capsys: pytest.CaptureFixture
) -> None:
    before = metrics(two_epochs)
    interrupt = "+callbacks.stop._target_=tests.zoo.spoil.Interrupt"
    assert zoo("resume=run", "trainer.max_epochs=4", interrupt, "+callbacks.stop.epoch=3") == 130
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "metrics.json" in line
    assert f"resume={two_epochs}" in line
    assert metrics(two_epochs) == before
    (ranked,), _ = read_scored([two_epochs])
    assert ranked.folder == two_epochs
    assert zoo("resume=run", "callbacks.stop=null") == 0
    assert metrics(two_epochs)["epochs"] == 4, "it goes on with what was asked for"


def test_a_finished_run_without_its_last_checkpoint_does_not_begin_again(
    two_epochs: Path, zoo: Zoo, capsys: pytest.CaptureFixture
) -> None:
    (two_epochs / "checkpoints" / "last.ckpt").unlink()
    before = times(two_epochs)
    assert zoo("resume=run", "trainer.max_epochs=3") == 1
    said = capsys.readouterr().err
    assert "last.ckpt" in said
    assert "model.weights=run/checkpoints/best.ckpt" in said
    assert times(two_epochs) == before


def test_a_moved_run_ends_with_the_best_checkpoint_of_an_unbroken_one(
    zoo: Zoo, recorded: Written, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    # The greatest error counts as best, so that the best epoch is the first, before the move.
    overrides = (*SMALL, *data_of(recorded), "callbacks.best.mode=max")
    for folder, epochs in (("whole", 4), ("old", 2)):
        assert zoo(*overrides, f"trainer.max_epochs={epochs}", f"hydra.run.dir={folder}") == 0
    shutil.move(tmp_path / "old", tmp_path / "new")
    capfd.readouterr()
    assert zoo("resume=new", "trainer.max_epochs=4") == 0
    assert capfd.readouterr().err == ""
    assert metrics(tmp_path / "whole")["best_epoch"] == 1, "the setting shows nothing"
    assert metrics(tmp_path / "new")["best_epoch"] == 1
    for name in ("best", "last"):
        ours, theirs = weights(tmp_path / "new", name), weights(tmp_path / "whole", name)
        assert all(torch.equal(ours[key], theirs[key]) for key in theirs)
    assert not (tmp_path / "old").exists()


def test_a_run_that_fails_inside_an_epoch_resumes_inside_it(
    zoo: Zoo, recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = ("callbacks=inside_epoch", "callbacks.inside.every_n_train_steps=3")
    # LeNet has no dropout, whose random numbers begin with an epoch.
    overrides = (*SMALL, *data_of(recorded), *own, "model=lenet", "trainer.max_epochs=3")
    assert zoo(*overrides, "hydra.run.dir=whole") == 0
    batches, fed = BalancedBatches.__iter__, list[tuple[int, int]]()
    away = [True]

    def failing(sampler: BalancedBatches) -> Iterator[BatchKey]:
        for key in batches(sampler):
            fed.append((key.epoch, key.number))
            if away and fed[-1] == (1, 8):
                raise InputError("the server is away")
            yield key

    monkeypatch.setattr(BalancedBatches, "__iter__", failing)
    assert zoo(*overrides, "hydra.run.dir=failed") == 1
    fed.clear()
    away.clear()
    assert zoo("resume=failed") == 0
    # 17 batches an epoch: the last checkpoint follows step 24, the seventh of epoch 1.
    assert next(one for one in fed if one[0] == 1) == (1, 7)
    assert next(one for one in fed if one[0] == 2) == (2, 0), "a later epoch is whole"
    for name in ("best", "last"):
        ours, theirs = weights(tmp_path / "failed", name), weights(tmp_path / "whole", name)
        assert all(torch.equal(ours[key], theirs[key]) for key in theirs)


@pytest.mark.parametrize("trace", [".hydra", "status.json", "checkpoints"])
def test_a_new_run_does_not_replace_another(
    trace: str, zoo: Zoo, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    folder = tmp_path / "my run=1"
    folder.mkdir()
    (folder / trace).mkdir()
    before = times(folder)
    assert zoo("model=tiny", f"hydra.run.dir={folder}") == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert str(folder) in line
    assert "resume=" in line
    assert "hydra.run.dir=FOLDER" in line
    assert times(folder) == before


def test_a_folder_without_a_run_takes_one(zoo: Zoo, recorded: Written, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "log.txt").write_text("mine")
    arguments = (*SMALL, f"data.root={recorded.folder}", "trainer.max_epochs=0")
    assert zoo(*arguments, "hydra.run.dir=run") == 0
    assert (tmp_path / "run" / "log.txt").read_text() == "mine"


def test_a_run_replaces_no_file_that_is_there(zoo: Zoo, recorded: Written, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "metrics.json").write_text("mine")
    assert zoo(*SMALL, f"data.root={recorded.folder}", "hydra.run.dir=run") == 1
    assert [one.name for one in (tmp_path / "run").iterdir()] == ["metrics.json"]
    assert (tmp_path / "run" / "metrics.json").read_text() == "mine"


def test_a_run_that_another_process_trains_is_not_resumed(
    two_epochs: Path, zoo: Zoo, other_process: int, capsys: pytest.CaptureFixture
) -> None:
    write_status(two_epochs, "running")
    started = psutil.Process(other_process).create_time()
    change_status(two_epochs, pid=other_process, process_started=started)
    before = weights(two_epochs, "last")
    assert zoo("resume=run", "trainer.max_epochs=3") == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert f"process {other_process} on {os.uname().nodename}" in line
    assert "hydra.run.dir=FOLDER" in line
    assert read_status(two_epochs)["pid"] == other_process
    assert all(torch.equal(one, weights(two_epochs, "last")[key]) for key, one in before.items())


@pytest.mark.slow
def test_odd_names_are_trained_in_and_resumed(
    zoo: Zoo, recorded: Written, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """The recording, its cache, its split and the run have such names."""
    odd = tmp_path / "a${b} 'ï' [x]=1"
    odd.mkdir()
    (odd / "lake").symlink_to(recorded.folder)
    places = (f"data.root={odd / 'lake'}", f"data.cache={odd / 'cache'}")
    new = "b 'ï' [x]=1"  # is not there yet
    assert zoo(*SMALL, *places, "trainer.max_epochs=1", f"hydra.run.dir={new}") == 0
    assert str(Path(new) / "checkpoints" / "best.ckpt") in capsys.readouterr().out
    shutil.move(tmp_path / new, odd / "run")
    assert zoo(f"resume={odd / 'run'}", "trainer.max_epochs=2") == 0
    assert metrics(odd / "run")["epochs"] == 2
    again = (f"data.split={odd / 'run' / 'split.csv'}", "trainer.max_epochs=0")
    start = f"model.weights={odd / 'run' / 'checkpoints' / 'best.ckpt'}"
    assert zoo(*SMALL, *places, *again, start, "hydra.run.dir=again") == 0
    best = weights(odd / "run", "best")
    assert all(
        torch.equal(one, best[key]) for key, one in weights(tmp_path / "again", "last").items()
    )


@pytest.mark.parametrize(("typed", "name"), [("a\\${b}", "a${b}"), ("a\udcff", "a\\udcff")])
def test_a_name_that_no_run_can_have_is_refused(
    zoo: Zoo, typed: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert zoo(f"hydra.run.dir={typed}") == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert f"{tmp_path / name}: " in line
    assert "cannot write" in line
    assert "hydra.run.dir=FOLDER" in line
    assert list(tmp_path.iterdir()) == []


def test_no_checkpoint_is_named_that_is_not_there(
    zoo: Zoo, recorded: Written, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    arguments = (*SMALL, *data_of(recorded), "trainer.max_epochs=1")
    assert zoo(*arguments, "callbacks.best=null", "hydra.run.dir=run") == 0
    assert "best.ckpt" not in capsys.readouterr().out
    assert zoo("resume=run") == 0
    assert "best.ckpt" not in capsys.readouterr().out


@pytest.mark.slow
def test_two_processes_train_in_a_folder_with_an_odd_name(
    recorded: Written, tmp_path: Path
) -> None:
    arguments = (*SMALL, *data_of(recorded), "trainer=ddp_cpu", "trainer.max_epochs=1")
    folder = 'ï it\'s "x"=1'
    succeed(run(tmp_path, *arguments, f"hydra.run.dir={folder}", timeout=300))
    assert metrics(tmp_path / folder)["epochs"] == 1
    assert [path.name for path in tmp_path.iterdir() if path.name != "outputs"] == [folder]


@pytest.mark.slow
def test_of_two_new_runs_in_one_folder_one_is_refused(recorded: Written, tmp_path: Path) -> None:
    arguments = (*SMALL, f"data.root={recorded.folder}", "trainer.max_epochs=1")
    processes = [
        subprocess.Popen(
            command("zoo", *arguments, "hydra.run.dir=run", f"seed={seed}"),
            cwd=tmp_path,
            env=environment(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for seed in (1, 2)
    ]
    said = [process.communicate(timeout=120)[1] for process in processes]
    codes = [process.returncode for process in processes]
    assert sorted(codes) == [0, 1], said
    trained = codes.index(0) + 1
    assert "run: " in said[codes.index(1)]
    assert OmegaConf.load(tmp_path / "run" / ".hydra" / "config.yaml").seed == trained
    assert metrics(tmp_path / "run")["seed"] == trained
