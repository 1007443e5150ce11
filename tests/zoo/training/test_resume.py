"""Resuming a run: finished, moved, trained by another process, or after its disk was full."""

import csv
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import mock

import psutil
import pytest
import torch
from omegaconf import OmegaConf

from datamodules.balance import BalancedBatches, BatchKey
from tests.recordings import Written, write_recording
from tests.unchanged import unchanged
from tests.zoo.command_runs import Zoo, only_line, run, run_here, start, succeed
from tests.zoo.sweeps import change_status, status
from tests.zoo.trainings import SMALL, data_of, equal, metrics, weights
from zoo.base.errors import InputError
from zoo.base.process_pool import KilledProcessError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.results.scored import read_scored
from zoo.runs.run_record import Run
from zoo.runs.status import read_status, write_status
from zoo.scoring.evidence import training_command
from zoo.training.steering_module import SteeringModule

INTERRUPT = "tests.zoo.spoil.Interrupt"
Train = Callable[..., str]  # of the fixture


@pytest.fixture(scope="module")
def trained(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train for two epochs; tests copy the run."""
    cwd = tmp_path_factory.mktemp("trained")
    arguments = (*SMALL, *data_of(recorded))
    succeed(run_here(cwd, *arguments, "trainer.max_epochs=2", "hydra.run.dir=run"))
    return cwd / "run"


@pytest.fixture
def two_epochs(trained: Path, tmp_path: Path) -> Path:
    """Copy the finished run of two epochs for one test."""
    return Path(shutil.copytree(trained, tmp_path / "run"))


def test_a_finished_run_is_left_as_it_is(two_epochs: Path, zoo: Zoo) -> None:
    for overrides in ([], ["trainer.max_epochs=2"]):
        with unchanged(two_epochs):
            result = zoo(f"resume={two_epochs}", *overrides)
        files = (str(two_epochs / name) for name in ("checkpoints/best.ckpt", "report/index.html"))
        for words in ("after 2 epochs", *files, f"resume={two_epochs} trainer.max_epochs=4"):
            assert words in succeed(result)
        assert result.stderr == ""


@pytest.mark.parametrize(
    ("override", "text"),
    [
        ("trainer.max_epochz=3", "did you mean trainer.max_epochs"),
        ("trainer.max_epochs=[", "trainer.max_epochs=["),
        ("trainer.max_epochs=3,4", "is a sweep"),
        ("seed=1,2", "seed=1,2: is a sweep"),
        ("-m trainer.max_epochs=3", "-m starts a sweep"),
        ("model=lenet", "keeps its config groups"),
    ],
)
def test_a_wrong_override_is_named(override: str, text: str, two_epochs: Path, zoo: Zoo) -> None:
    with unchanged(two_epochs):
        assert text in only_line(zoo(f"resume={two_epochs}", *override.split()), 2)


STOPPING = "lightning.pytorch.callbacks.EarlyStopping"
STOPPING = {"early_stopping": {"_target_": STOPPING, "monitor": "val/mse"}}


def test_a_run_that_was_stopped_early_is_finished(two_epochs: Path, zoo: Zoo) -> None:
    change_config(two_epochs, trainer={"max_epochs": 30}, callbacks=STOPPING)
    printed = succeed(zoo("resume=run"))
    assert "after 2 epochs of 30" in printed
    assert "resume=run callbacks.early_stopping=null" in printed
    assert metrics(two_epochs)["epochs"] == 2


def test_a_finished_run_that_fails_to_train_further_keeps_its_figures_and_rank(
    two_epochs: Path, trained: Path, zoo: Zoo, tmp_path: Path
) -> None:
    before = metrics(two_epochs)
    other = write_recording(tmp_path / "other", rows=110)
    line = only_line(zoo("resume=run", "trainer.max_epochs=3", f"data.root={other.folder}"), 1)
    assert "was trained on 120 rows" in line
    assert "now holds 110" in line
    assert metrics(two_epochs) == before
    assert equal(weights(two_epochs), weights(trained))
    assert status(two_epochs) == "failed"
    assert read_status(two_epochs)["finished_epochs"] == 2
    (run,), unranked = read_scored([two_epochs])
    assert (run.folder, unranked) == (two_epochs, [])
    succeed(zoo("resume=run", "trainer.max_epochs=3"))
    assert metrics(two_epochs)["epochs"] == 3
    assert status(two_epochs) == "finished"
    assert "finished_epochs" not in read_status(two_epochs)
    config = OmegaConf.load(two_epochs / ".hydra" / "config.yaml")
    assert config.trainer.max_epochs == 3, "a run that is stopped again needs it"


def test_a_run_that_was_trained_further_is_repeated_and_ranked_by_its_keys(
    two_epochs: Path, zoo: Zoo
) -> None:
    images = "data.images='\N{SLIGHTLY SMILING FACE}/${b'"
    words = f'["model=tiny", "{images}", "trainer.max_epochs=2"]'
    (two_epochs / ".hydra/overrides.yaml").write_text(words, encoding="utf-8")
    succeed(zoo("resume=run", "trainer.max_epochs=3", "trainer.log_every_n_steps=9"))
    command = training_command(Run(two_epochs).overrides, {})  # as its report shows it
    assert "trainer.max_epochs=3" in command
    assert "trainer.max_epochs=2" not in command
    assert command.count("trainer.log_every_n_steps=9") == 1
    ((ranked,), _) = read_scored([two_epochs])
    assert ranked.overrides["trainer.max_epochs"] == "3"
    assert images in Run(two_epochs).overrides


def test_the_duration_of_a_resumed_run_has_the_epochs_before(two_epochs: Path, zoo: Zoo) -> None:
    checkpoint = two_epochs / "checkpoints" / "last.ckpt"
    contents = torch.load(checkpoint, weights_only=True)
    contents["trained"][2] = 5000.0  # seconds
    torch.save(contents, checkpoint)
    succeed(zoo("resume=run", "trainer.max_epochs=3"))
    assert 5000 < metrics(two_epochs)["wall_s"] < 6000
    assert metrics(two_epochs)["seconds_per_epoch"] == pytest.approx(5000 / 3, rel=0.1)


def test_ctrl_c_while_training_further_names_the_figures_that_stand(
    two_epochs: Path, zoo: Zoo
) -> None:
    before = metrics(two_epochs)
    change_config(two_epochs, callbacks={"stop": {"_target_": INTERRUPT, "epoch": 3}})
    trust = f"trust={INTERRUPT}"
    line = only_line(zoo("resume=run", "trainer.max_epochs=4", trust), 130)
    assert "metrics.json" in line
    assert f"resume={two_epochs}" in line
    assert metrics(two_epochs) == before
    (ranked,), _ = read_scored([two_epochs])
    assert ranked.folder == two_epochs
    succeed(zoo("resume=run", "callbacks.stop=null"))
    assert metrics(two_epochs)["epochs"] == 4, "it goes on with what was asked for"


@pytest.mark.parametrize(("epoch", "words"), [(2, "stopped in epoch 4; "), (3, "stopped; ")])
def test_a_signal_between_epochs_names_no_epoch_beyond_the_last(
    epoch: int, words: str, two_epochs: Path, zoo: Zoo
) -> None:
    terminate = INTERRUPT.replace("Interrupt", "Terminate")
    change_config(two_epochs, callbacks={"stop": {"_target_": terminate, "epoch": epoch}})
    line = only_line(zoo("resume=run", "trainer.max_epochs=4", f"trust={terminate}"), 130)
    assert line.startswith(f"drivezoo train: {words}")
    assert "last.ckpt is kept" in line


# Of each kind: optimizer, schedule, loss, data, view, network, seed, trainer, callbacks' state.
FORBIDDEN = {
    "optim.lr": "1e-9",
    "+optim.betas": "[0.8,0.9]",
    "schedule.factor": "0.5",
    "loss._target_": "torch.nn.L1Loss",
    "seed": "2",
    "data.crop": "[40,20]",
    "data.flip": "0",
    "data.val_share": "0.2",
    "data.augment.brightness.p": "0.5",
    "model.size": "[10,30]",
    "trainer.gradient_clip_val": "1",
    "trainer.precision": "bf16-mixed",
    "callbacks.best.monitor": "val/mae",
    "callbacks.best": "null",
    "+callbacks.more._target_": "lightning.pytorch.callbacks.Timer",
    "quick_samples": "10 quick=true",
}


@pytest.mark.parametrize("key", FORBIDDEN)
def test_a_key_that_the_finished_epochs_forbid_is_refused(
    key: str, two_epochs: Path, zoo: Zoo
) -> None:
    words = f"{key}={FORBIDDEN[key]}".split()
    with unchanged(two_epochs):  # or the config says what was not trained
        line = only_line(zoo("resume=run", "trainer.max_epochs=13", *words), 2)
    name = {"quick_samples": "data.samples_per_epoch"}.get(key, key.lstrip("+"))
    assert f": {name}" in line
    assert "model.weights=run/checkpoints/last.ckpt" in line


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("optim", "lr", 1e-9),
        ("data", "batch_size", 7),
        ("loss", "_target_", "torch.nn.L1Loss"),
        ("model", "_target_", "zoo.models.lenet.LeNet"),
    ],
)
def test_a_config_that_was_changed_by_hand_is_refused_as_the_keys_are(
    section: str, key: str, value: object, two_epochs: Path, zoo: Zoo
) -> None:
    change_config(two_epochs, **{section: {key: value}}, trainer={"max_epochs": 3})
    change_status(two_epochs, status="stopped")
    before = weights(two_epochs)
    line = only_line(zoo("resume=run"), 1)
    for words in ("config.yaml", f"{section}.{key} is {value}, and was", "model.weights="):
        assert words in line
    assert equal(weights(two_epochs), before)


def test_keys_that_change_no_finished_epoch_are_obeyed(
    two_epochs: Path, zoo: Zoo, recorded: Written, tmp_path: Path
) -> None:
    moved = shutil.copytree(recorded.folder, tmp_path / "moved")
    machine = (f"data.root={moved}", "data.workers=0", "trainer.max_epochs=3")
    logged = ("trainer.log_every_n_steps=1", "logger.tensorboard=null", "callbacks.progress=null")
    succeed(zoo("resume=run", *machine, *logged))
    config = OmegaConf.load(two_epochs / ".hydra" / "config.yaml")
    assert (config.data.root, config.callbacks.progress) == (str(moved), None)


def test_a_schedule_that_ends_with_the_epochs_is_not_drawn_out(two_epochs: Path, zoo: Zoo) -> None:
    cosine = {"_target_": "torch.optim.lr_scheduler.CosineAnnealingLR", "_partial_": True}
    change_config(two_epochs, schedule=cosine | {"T_max": "${trainer.max_epochs}", "factor": None})
    line = only_line(zoo("resume=run", "trainer.max_epochs=4"), 2)
    assert "trainer.max_epochs=4: schedule.T_max was 2 " in line
    assert "train further" not in succeed(zoo("resume=run")), "it names what is refused"


@pytest.mark.parametrize("limit", [{"max_steps": 4}, {"max_time": "00:01:00:00"}])
def test_early_stopping_is_left_out_of_no_run_that_a_limit_ended(
    limit: dict, two_epochs: Path, zoo: Zoo
) -> None:
    change_config(two_epochs, trainer={"max_epochs": 9, **limit}, callbacks=STOPPING)
    assert "callbacks.early_stopping=null" not in succeed(zoo("resume=run"))


def test_a_loss_that_is_not_finite_stops_and_keeps_the_last_good_checkpoint(
    two_epochs: Path, trained: Path, zoo: Zoo
) -> None:
    # Resume with a rate at which weights overflow.
    checkpoint = two_epochs / "checkpoints" / "last.ckpt"
    contents = torch.load(checkpoint, weights_only=True)
    for group in contents["optimizer_states"][0]["param_groups"]:
        group["lr"] = group["initial_lr"] = 1e38
    contents["lr_schedulers"][0]["_last_lr"] = [1e38, 1e38]
    contents["lr_schedulers"][0]["base_lrs"] = [1e38, 1e38]
    torch.save(contents, checkpoint)
    line = only_line(zoo("resume=run", "trainer.max_epochs=4"))
    assert "the loss is not finite in epoch 3" in line
    assert equal(weights(two_epochs), weights(trained))
    assert status(two_epochs) == "failed"
    assert "not finite" in read_status(two_epochs)["reason"]


def test_a_damaged_log_is_named_before_the_next_epoch(two_epochs: Path, zoo: Zoo) -> None:
    log = two_epochs / "metrics.csv"
    log.write_text(log.read_text().replace("\n0,", "\n0.,", 1))
    before = weights(two_epochs, "last")
    line = only_line(zoo("resume=run", "trainer.max_epochs=3"), 1)
    assert "metrics.csv, row 2: " in line
    assert "remove it" in line
    assert equal(weights(two_epochs, "last"), before)


def test_a_log_of_another_program_stays_beside_the_new_one(two_epochs: Path, zoo: Zoo) -> None:
    log = two_epochs / "metrics.csv"
    log.write_text(text := log.read_text().replace(",", ";"))
    succeed(zoo("resume=run", "trainer.max_epochs=3"))
    assert (two_epochs / "metrics.1.csv").read_text() == text


def test_fewer_epochs_than_are_finished_are_refused(two_epochs: Path, zoo: Zoo) -> None:
    change_status(two_epochs, status="stopped")
    line = only_line(zoo("resume=run", "trainer.max_epochs=1"), 2)
    assert "trainer.max_epochs=1: 2 epochs" in line


@pytest.fixture(scope="module")
def stopped_early(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train until the error has risen twice; tests copy the run."""
    cwd = tmp_path_factory.mktemp("early")
    succeed(run_here(cwd, *EARLY, *data_of(recorded), "hydra.run.dir=run"))
    assert metrics(cwd / "run")["epochs"] < 12, "the setting shows nothing"
    return cwd / "run"


@pytest.fixture
def early(stopped_early: Path, tmp_path: Path) -> Path:
    """Copy that run for one test."""
    return Path(shutil.copytree(stopped_early, tmp_path / "run"))


PATIENCE = "callbacks.early_stopping.patience"
EARLY = (*SMALL, "trainer.max_epochs=12", "optim.lr=0.5", "callbacks=early_stopping")
EARLY = (*EARLY, "data.samples_per_epoch=64", f"{PATIENCE}=2")
EARLY = (*EARLY, "schedule=plateau", "schedule.patience=0")  # steps in the last epoch, too


@pytest.mark.parametrize("words", ["", f" {PATIENCE}=2"])
def test_more_epochs_after_early_stopping_need_more_patience(
    words: str, early: Path, zoo: Zoo
) -> None:
    with unchanged(early):
        line = only_line(zoo("resume=run", "trainer.max_epochs=60", *words.split()), 2)
    assert f"add {PATIENCE}=NUMBER, above 2, or callbacks.early_stopping=null" in line
    only_line(zoo("resume=run", f"{PATIENCE}=1"), 2)


@pytest.fixture(scope="module")
def patient(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train all epochs at once."""
    cwd = tmp_path_factory.mktemp("patient")
    succeed(run_here(cwd, *EARLY, *data_of(recorded), f"{PATIENCE}=20", "hydra.run.dir=run"))
    assert metrics(cwd / "run")["epochs"] == 12
    return cwd / "run"


@pytest.mark.parametrize("change", [f"{PATIENCE}=20", "callbacks.early_stopping=null"])
def test_a_resumed_run_waits_as_long_as_an_unbroken_one(
    change: str, early: Path, patient: Path, zoo: Zoo
) -> None:
    succeed(zoo("resume=run", change))
    assert metrics(early)["epochs"] == 12
    for name in ("best", "last"):
        assert equal(weights(early, name), weights(patient, name))


def test_a_run_that_was_stopped_while_it_was_scored_trains_no_further_epoch(
    early: Path, zoo: Zoo
) -> None:
    change_status(early, status="stopped")
    before, epochs = weights(early), metrics(early)["epochs"]
    succeed(zoo("resume=run"))
    assert equal(weights(early), before)
    assert metrics(early)["epochs"] == epochs


def test_rows_that_change_their_part_are_not_trained_further(
    train: Train, zoo: Zoo, tmp_path: Path
) -> None:
    train("hydra.run.dir=first", "trainer.max_epochs=1")
    split = Path(shutil.copy(tmp_path / "first" / "split.csv", tmp_path / "split.csv"))
    train("data.split=split.csv", "trainer.max_epochs=1")
    kept = split.read_text()
    split.write_text(kept.replace(",val", ",other").replace(",test", ",val"))
    split.write_text(split.read_text().replace(",other", ",test"))
    line = only_line(zoo("resume=run", "trainer.max_epochs=2"), 1)
    assert "split.csv: data.split gives other rows now" in line
    split.write_text(kept)
    succeed(zoo("resume=run"))


def test_early_stopping_in_the_first_epoch_is_an_end_too(
    train: Train, zoo: Zoo, tmp_path: Path
) -> None:
    train("callbacks=early_stopping", "+callbacks.early_stopping.stopping_threshold=5")
    change_status(tmp_path / "run", status="stopped")
    succeed(zoo("resume=run"))
    assert metrics(tmp_path / "run")["epochs"] == 1
    assert "early stopping ended the run" in only_line(
        zoo("resume=run", "trainer.max_epochs=60"), 2
    )


def change_config(run: Path, **sections: dict) -> None:
    """Change keys of sections in a run's saved config; None removes one."""
    path = run / ".hydra" / "config.yaml"
    config = OmegaConf.load(path)
    for section, values in sections.items():
        for key, value in values.items():
            config[section].pop(key, None)
            if value is not None:
                config[section][key] = value
    OmegaConf.save(config, path)


def test_a_finished_run_without_its_last_checkpoint_does_not_begin_again(
    two_epochs: Path, zoo: Zoo
) -> None:
    (two_epochs / "checkpoints" / "last.ckpt").unlink()
    with unchanged(two_epochs):
        line = only_line(zoo("resume=run", "trainer.max_epochs=3"), 1)
    assert "last.ckpt" in line
    assert "model.weights=run/checkpoints/best.ckpt" in line


class Planned(SteeringModule):
    """A module with a schedule of the user's, which counts the steps and follows a figure."""

    def make_schedule(self, optimizer: torch.optim.Optimizer) -> dict:
        assert self.trainer.estimated_stepping_batches % 9 == 0
        schedule = torch.optim.lr_scheduler.ReduceLROnPlateau(optimizer, patience=0)
        return {"scheduler": schedule, "monitor": "train/loss"}


PLANNED = f"{__name__}.Planned"


@pytest.mark.parametrize("more", ["", f"module._target_={PLANNED} +trainer.limit_train_batches=9"])
def test_a_moved_run_ends_with_the_best_checkpoint_of_an_unbroken_one(
    more: str,
    train: Train,
    zoo: Zoo,
    tmp_path: Path,
    capfd: pytest.CaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    batches = BalancedBatches.__iter__  # all drawn at the start, as for data.workers
    monkeypatch.setattr(BalancedBatches, "__iter__", lambda keys: iter([*batches(keys)]))
    # The error rises, so that the best epoch is the first, before the move.
    for folder, epochs in (("whole", 4), ("old", 2)):
        keys = (f"trainer.max_epochs={epochs}", f"hydra.run.dir={folder}")
        train("+optim.maximize=true", *keys, *more.split())
    with (tmp_path / "old" / "metrics.csv").open("a") as log:
        log.write("1,0.0")  # the begin of a row, as a killed run leaves it
    shutil.move(tmp_path / "old", tmp_path / "new")
    capfd.readouterr()
    succeed(zoo("resume=new", "trainer.max_epochs=4", f"trust={PLANNED}"))
    assert capfd.readouterr().err == ""
    assert metrics(tmp_path / "whole")["best_epoch"] == 1, "the setting shows nothing"
    assert metrics(tmp_path / "new")["best_epoch"] == 1
    for name in ("best", "last"):
        assert equal(weights(tmp_path / "new", name), weights(tmp_path / "whole", name))
    logs = [(tmp_path / run / "metrics.csv").read_text() for run in ("new", "whole")]
    assert logs[0] == logs[1]
    assert not (tmp_path / "old").exists()


@pytest.mark.slow  # a training of a study starts so, too
def test_a_run_without_an_epoch_resumes_at_the_first(
    train: Train, zoo: Zoo, tmp_path: Path
) -> None:
    for folder, epochs in (("whole", 1), ("part", 0)):
        train(f"trainer.max_epochs={epochs}", f"hydra.run.dir={folder}")
    succeed(zoo("resume=part", "trainer.max_epochs=1"))
    assert equal(weights(tmp_path / "part", "last"), weights(tmp_path / "whole", "last"))


def test_a_run_that_fails_inside_an_epoch_resumes_inside_it(
    zoo: Zoo, recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    extra = ("callbacks=inside_epoch", "callbacks.inside.every_n_train_steps=3")
    extra += ("callbacks.fed_batch=null", "callbacks.steering_histogram=null")
    # Without dropout, whose random numbers begin with an epoch.
    overrides = (*SMALL, *data_of(recorded), *extra, "model.dropout=0.0", "trainer.max_epochs=3")
    succeed(zoo(*overrides, "hydra.run.dir=whole"))
    batches, fed = BalancedBatches.__iter__, list[tuple[int, int]]()
    away = [True]

    def failing(sampler: BalancedBatches) -> Iterator[BatchKey]:
        for key in batches(sampler):
            fed.append((key.epoch, key.number))
            if away and fed[-1] == (1, 8):
                raise InputError("the server is away")
            yield key

    monkeypatch.setattr(BalancedBatches, "__iter__", failing)
    only_line(zoo(*overrides, "hydra.run.dir=failed"), 1)
    fed.clear()
    away.clear()
    succeed(zoo("resume=failed"))
    # 17 batches an epoch: the last checkpoint follows step 24, the seventh of epoch 1.
    assert next(batch for batch in fed if batch[0] == 1) == (1, 7)
    assert next(batch for batch in fed if batch[0] == 2) == (2, 0), "a later epoch is whole"
    samples = [metrics(tmp_path / run)["train_samples"] for run in ("failed", "whole")]
    assert samples[0] == samples[1]
    logs = [csv.DictReader((tmp_path / run / "metrics.csv").open()) for run in ("failed", "whole")]
    losses = [[row["train/loss"] for row in log if row["train/loss"]] for log in logs]
    assert losses[0] == losses[1], "each is the mean of a whole epoch"
    for name in ("best", "last"):
        assert equal(weights(tmp_path / "failed", name), weights(tmp_path / "whole", name))


def test_more_steps_resume_inside_the_epoch_in_which_the_first_ones_ended(
    train: Train, zoo: Zoo, tmp_path: Path
) -> None:
    keys = ("model.dropout=0.0", "trainer.max_epochs=3")
    train(*keys, "hydra.run.dir=whole")
    train(*keys, "trainer.max_steps=24")
    ended = metrics(tmp_path / "run")
    assert (ended["epochs"], ended["train_samples"]) == (2, 267 + 7 * 16), "17 and 7 batches"
    change_status(tmp_path / "run", status="stopped")
    succeed(zoo("resume=run"))
    for key in ("epochs", "train_samples"):
        assert metrics(tmp_path / "run")[key] == ended[key], "no step is left to take"
    succeed(zoo("resume=run", "trainer.max_steps=40"))
    succeed(zoo("resume=run", "trainer.max_steps=-1"))
    assert equal(weights(tmp_path / "run"), weights(tmp_path / "whole"))
    for key in ("epochs", "train_samples"):
        assert metrics(tmp_path / "run")[key] == metrics(tmp_path / "whole")[key]


def test_a_run_whose_drive_is_killed_fails_and_names_how_to_resume(
    zoo: Zoo, recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = KilledProcessError("workers=2: a process was killed; try workers=1")
    monkeypatch.setattr("zoo.scoring.track_scores.all_drives", mock.Mock(side_effect=killed))
    keys = ("score=lake", "trainer.max_epochs=0", "hydra.run.dir=run")
    line = only_line(zoo(*SMALL, *data_of(recorded), *keys), 1)
    assert "score.workers=2: a process was killed; try ++score.workers=1, and" in line
    assert f"resume={tmp_path / 'run'}" in line


@pytest.mark.parametrize("trace", [".hydra", "status.json", "checkpoints", "metrics.json"])
def test_a_new_run_does_not_replace_another(trace: str, zoo: Zoo, tmp_path: Path) -> None:
    folder = tmp_path / "my run=1"
    (folder / trace).mkdir(parents=True)
    with unchanged(folder):
        line = only_line(zoo("model=tiny", f"hydra.run.dir={folder}"), 1)
    for words in (str(folder), "resume=", "hydra.run.dir=FOLDER"):
        assert words in line


def test_a_folder_without_a_run_takes_one(train: Train, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "log.txt").write_text("mine")
    train("trainer.max_epochs=0")
    assert (tmp_path / "run" / "log.txt").read_text() == "mine"


def test_a_run_that_another_process_trains_is_not_resumed(
    two_epochs: Path, zoo: Zoo, other_process: psutil.Process
) -> None:
    pid, started = other_process.pid, other_process.create_time()
    write_status(two_epochs, "running")
    change_status(two_epochs, pid=pid, process_started=started)
    before = weights(two_epochs)
    line = only_line(zoo("resume=run", "trainer.max_epochs=3"), 1)
    assert f"process {pid} on {os.uname().nodename}" in line
    assert "hydra.run.dir=FOLDER" in line
    assert read_status(two_epochs)["pid"] == pid
    assert equal(weights(two_epochs), before)


@pytest.mark.slow
def test_odd_names_are_trained_in_and_resumed(zoo: Zoo, recorded: Written, tmp_path: Path) -> None:
    """The recording, its cache, its split and the run have such names."""
    odd = tmp_path / "a${b} 'ï' [x]=1"
    odd.mkdir()
    (odd / "lake").symlink_to(recorded.folder)
    places = (f"data.root={odd / 'lake'}", f"data.cache={odd / 'cache'}")
    new = "b 'ï' [x]=1"  # is not there yet
    printed = succeed(zoo(*SMALL, *places, "trainer.max_epochs=1", f"hydra.run.dir={new}"))
    assert str(Path(new) / "checkpoints" / "best.ckpt") in printed
    shutil.move(tmp_path / new, odd / "run")
    succeed(zoo(f"resume={odd / 'run'}", "trainer.max_epochs=2"))
    assert metrics(odd / "run")["epochs"] == 2
    again = (f"data.split={odd / 'run' / 'split.csv'}", "trainer.max_epochs=0")
    start = f"model.weights={odd / 'run' / 'checkpoints' / 'best.ckpt'}"
    succeed(zoo(*SMALL, *places, *again, start, "hydra.run.dir=again"))
    assert equal(weights(tmp_path / "again"), weights(odd / "run", "best"))


@pytest.mark.parametrize(("typed", "name"), [("a\\${b}", "a${b}"), ("a\udcff", "a\\udcff")])
def test_a_name_that_no_run_can_have_is_refused(
    zoo: Zoo, typed: str, name: str, tmp_path: Path
) -> None:
    line = only_line(zoo(f"hydra.run.dir={typed}"), 1)
    for words in (f"{tmp_path / name}: ", "cannot write", "hydra.run.dir=FOLDER"):
        assert words in line
    assert list(tmp_path.iterdir()) == []


def test_no_checkpoint_is_named_that_is_not_there(train: Train, zoo: Zoo) -> None:
    assert "best.ckpt" not in train("trainer.max_epochs=1", "callbacks.best=null")
    assert "best.ckpt" not in succeed(zoo("resume=run"))


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
    arguments += ("hydra.run.dir=run",)
    processes = [start(tmp_path, "zoo", *arguments, f"seed={seed}") for seed in (1, 2)]
    outputs = [process.communicate(timeout=120)[0] for process in processes]
    codes = [process.returncode for process in processes]
    assert sorted(codes) == [0, 1], outputs
    trained = codes.index(0) + 1
    assert outputs[codes.index(1)].startswith("drivezoo train: run: ")
    assert OmegaConf.load(tmp_path / "run" / ".hydra" / "config.yaml").seed == trained
    assert metrics(tmp_path / "run")["seed"] == trained


@pytest.fixture
def unlimited() -> Iterator[None]:
    """Restore the limit on the size of files after the test."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


SPOIL = "+callbacks.spoil"


@pytest.mark.skipif(os.name != "posix", reason="limits the size of files")
@pytest.mark.usefixtures("unlimited")
def test_a_checkpoint_that_cannot_be_written_is_named_and_the_last_one_kept(
    recorded: Written, tmp_path: Path, zoo: Zoo
) -> None:
    limit = (f"{SPOIL}._target_=tests.zoo.spoil.LimitFiles", f"{SPOIL}.limit=5000")
    keys = (*data_of(recorded), *limit, f"{SPOIL}.epoch=2", "trainer.max_epochs=4")
    line = only_line(zoo(*SMALL, *keys, "hydra.run.dir=run"), 1)
    checkpoints = tmp_path / "run" / "checkpoints"
    kept, resume = f"{checkpoints / 'last.ckpt'} is kept", f"resume={tmp_path / 'run'}"
    for words in (f"{checkpoints}/", "File too large", "once it can be written", kept, resume):
        assert words in line
    assert {path.name for path in checkpoints.iterdir()} == {"best.ckpt", "last.ckpt"}
    assert load_checkpoint(checkpoints / "last.ckpt").network is not None
    assert status(tmp_path / "run") == "failed"


def test_a_folder_removed_in_the_middle_is_named_in_one_line(
    recorded: Written, tmp_path: Path, zoo: Zoo
) -> None:
    remove = (f"{SPOIL}._target_=tests.zoo.spoil.RemoveFolder", f"{SPOIL}.epoch=1")
    keys = (*data_of(recorded), *remove, "trainer.max_epochs=4")
    line = only_line(zoo(*SMALL, *keys, "hydra.run.dir=run"), 1)
    assert f"{tmp_path / 'run'} was removed" in line
    assert not (tmp_path / "run").exists()
