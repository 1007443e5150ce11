"""Keys of Lightning's Trainer in a whole run: rarer validations, precisions, profilers, limits."""

import signal
from pathlib import Path

import numpy as np
import pytest
import torch

from datamodules.view import View
from tests.recordings import Written
from tests.slow_members import slow
from tests.zoo.command_runs import Zoo, only_line, succeed
from tests.zoo.compositions import composed
from tests.zoo.trainings import SMALL, data_of, equal, weights
from zoo.base.run_command import raise_interrupts
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.models.make_network import make_network
from zoo.runs.run_record import Run
from zoo.training import conclusion
from zoo.training.closed_loop import ClosedLoop
from zoo.training.conclusion import read_curves

NO_ROWS = "trainer.limit_val_batches=0 callbacks.best.monitor=train/loss"


@pytest.mark.parametrize(
    ("keys", "epochs", "best"),
    [
        ("trainer.check_val_every_n_epoch=2 trainer.max_epochs=4", 4, "lowest val/mse"),
        ("trainer.check_val_every_n_epoch=3", 2, "last epoch"),
        ("trainer.check_val_every_n_epoch=2 schedule=plateau", 2, "lowest val/mse"),
        ("trainer.max_steps=3", 1, "epoch 1: last epoch"),
        *slow(("trainer.max_steps=20 trainer.max_epochs=9", 2, "lowest val/mse")),
        ("trainer.val_check_interval=0.5 trainer.max_epochs=1", 1, "lowest val/mse"),
        ("trainer.max_epochs=0", 0, "epoch 0: the initial weights"),
        (f"{NO_ROWS} callbacks.early_stopping=null", 2, "lowest train/loss"),
    ],
)
def test_a_run_ends_whole_however_rare_validations_are(
    keys: str, epochs: int, best: str, train, tmp_path: Path
) -> None:
    printed = train("callbacks=early_stopping", "trainer.max_epochs=2", *keys.split())
    (line,) = [text for text in printed.splitlines() if text.startswith("best.ckpt is of epoch")]
    assert best in line
    figures = Run(tmp_path / "run").metrics
    assert figures["epochs"] == epochs
    assert figures["best_epoch"] == (figures["choice"]["epoch"] or None)
    for name in ("best", "last"):
        load_checkpoint(tmp_path / "run" / "checkpoints" / f"{name}.ckpt")


def test_a_figure_between_validations_counts_once_for_early_stopping(train, tmp_path: Path) -> None:
    keys = ("callbacks=early_stopping", "callbacks.early_stopping.patience=2", "optim.lr=0.5")
    keys += ("data.samples_per_epoch=64", "trainer.check_val_every_n_epoch=2")
    printed = train(*keys, "trainer.max_epochs=40")
    errors = [*read_curves(tmp_path / "run")["val/mse"].values()]
    assert len(errors) == errors.index(min(errors)) + 1 + 2
    assert printed.count("  val/mse ") == len(errors), "an old figure is printed again"
    assert Run(tmp_path / "run").metrics["epochs"] == 2 * len(errors)


def test_a_profiler_prints_its_summary(train) -> None:
    assert "run_training_epoch" in train("trainer.profiler=simple", "trainer.max_epochs=1")


def test_a_trial_run_writes_no_checkpoint(train, tmp_path: Path) -> None:
    train("trainer.fast_dev_run=true")
    assert not list(tmp_path.glob("run/checkpoints/*"))


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("trainer.logger=false", "type logger=NAME"),
        ("trainer.callbacks=null", "type callbacks=NAME"),
        ("trainer.enable_checkpointing=false", "type callbacks=NAME"),
        ("trainer.default_root_dir=x", "type hydra.run.dir=FOLDER"),
        ("trainer.overfit_batches=2", "type trainer.limit_train_batches=N"),
        ("trainer.limit_val_batches=0", "trainer.limit_val_batches=0 leaves no validation rows"),
        (f"{NO_ROWS} schedule=plateau", "leaves no validation rows; set another number, or sch"),
        ("trainer.limit_val_batches=0.5", "limit_val_batches=1.0"),
        ("trainer.val_check_interval=1000", "trainer: `val_check_interval` (1000) must be less"),
        ("trainer.detect_anomaly=true optim.lr=1e30", "returned nan values"),
        ("trainer.accumulate_grad_batches=0", "a whole number of 1 or more"),
    ],
)
def test_a_trainers_key_that_cannot_be_obeyed_is_one_line(
    keys: str, words: str, zoo: Zoo, recorded: Written
) -> None:
    assert words in only_line(zoo(*SMALL, *data_of(recorded), *keys.split()))


@pytest.mark.parametrize("precision", ["bf16-true", *slow("bf16-mixed", "64-true")])
def test_a_run_in_another_precision_ends_with_figures_and_resumes(
    precision: str, train, zoo: Zoo, tmp_path: Path
) -> None:
    key = f"trainer.precision={precision}"
    train(key, "trainer.max_epochs=2")
    run = Run(tmp_path / "run")
    assert np.isfinite(run.metrics["open_loop"]["val"]["mse"])
    assert run.metrics["precision"] == precision
    succeed(zoo("resume=run", "trainer.max_epochs=3"))
    train(key, "trainer.max_epochs=3", "hydra.run.dir=whole")
    assert equal(weights(tmp_path / "run"), weights(tmp_path / "whole"))


@pytest.mark.parametrize("dtype", [torch.float64, torch.bfloat16])
def test_a_drive_between_epochs_takes_a_network_of_any_precision(dtype: torch.dtype) -> None:
    view = View((50, 0), "hsv_s", (11, 32))
    network = make_network(composed("model=tiny")["model"], view).to(dtype)
    callback = ClosedLoop(starts=1, metres=1, quality="simple")
    callback._open()
    figures = callback.drive(network, view, {})
    callback.world.close()
    assert figures["autonomy"] == 1
    assert next(network.parameters()).dtype == dtype


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", *slow("SIGHUP", "SIGUSR1")])
def test_a_stop_while_it_is_scored_names_the_command_that_resumes(
    name: str, zoo: Zoo, recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    number = getattr(signal, name)
    usual = signal.default_int_handler if name == "SIGINT" else signal.SIG_DFL
    before = signal.signal(number, usual)  # the tests may run under nohup
    words = (*SMALL, *data_of(recorded), "trainer.max_epochs=2", "hydra.run.dir=run")
    with monkeypatch.context() as patch:
        patch.setattr(conclusion, "evaluate_rows", lambda *_: signal.raise_signal(number))
        try:
            line = only_line(zoo(*words), 130)
        finally:
            signal.signal(number, before)
    assert line.endswith(f"resume with: drivezoo train resume={tmp_path / 'run'}")
    assert Run(tmp_path / "run").state == "stopped"
    trained = weights(tmp_path / "run")
    succeed(zoo("resume=run"))
    assert Run(tmp_path / "run").state == "finished"
    assert equal(weights(tmp_path / "run"), trained)


def test_a_signal_that_is_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        raise_interrupts()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
