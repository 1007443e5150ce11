"""The main job as a person runs it: real recordings, real processes."""

import csv
import signal
from importlib.metadata import version
from pathlib import Path

import pytest
import torch
from PIL import Image

from tests.recordings import Written, write_recording
from tests.zoo.command_runs import Zoo, only_line, run, run_here, start, succeed
from tests.zoo.sweeps import status
from tests.zoo.trainings import SMALL, data_of, equal, metrics, weights
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.runs.status import read_status
from zoo.training.conclusion import read_curves


def test_a_run_leaves_what_the_design_says(run_folder: Path) -> None:
    assert status(run_folder) == "finished"
    assert (run_folder / ".hydra" / "config.yaml").is_file()
    assert list(run_folder.glob("events.out.tfevents.*"))
    rows = list(csv.DictReader((run_folder / "metrics.csv").open()))
    for figure in ("val/mse", "train/loss"):
        assert {row["epoch"] for row in rows if row[figure]} == {"0", "1"}
    for name in ("best", "last"):
        assert load_checkpoint(run_folder / "checkpoints" / f"{name}.ckpt").network is not None
    pictures = {"fed_batch", "steering_histogram", "training_curves"}
    pictures |= {f"predicted_against_true_{part}" for part in ("val", "test")}
    assert {path.stem for path in (run_folder / "plots").glob("*.png")} == pictures
    for name in pictures:
        with Image.open(run_folder / "plots" / f"{name}.png") as picture:
            assert min(picture.size) > 300
            assert len(picture.convert("L").getcolors(256) or []) > 10, "an empty picture"


def test_metrics_stand_beside_both_baselines(run_folder: Path) -> None:
    printed = (run_folder / "stdout.txt").read_text()
    figures = metrics(run_folder)
    assert figures["parameters"] == 252_219
    assert set(figures["open_loop"]) == {"train", "val", "test"}
    for part, errors in figures["open_loop"].items():
        assert set(errors) == {"mse", "mae", "balanced_mae", "bias"}
        assert set(figures["baselines"][part]) == {"always zero", "mean"}
    assert set(figures["side_response"]) == {"val", "test"}
    assert all(-1 < response < 1 for response in figures["side_response"].values())
    for key in ("samples_per_second", "seconds_per_epoch", "wall_s"):
        assert figures[key] > 0
    assert (figures["seed"], figures["epochs"]) == (1, 2)
    assert len(figures["data"]["fingerprint"]) == 16
    assert len(load_checkpoint(run_folder).data["row_hashes"]) == 120
    assert sum(figures["data"]["split"].values()) <= figures["data"]["rows"] == 120
    assert figures["versions"]["torch"] == version("torch")  # without +cpu or +cu130
    assert f"{figures['open_loop']['test']['mse']:.4f}" in printed
    for words in ("nvidia", "always zero", "mean", "balanced MAE", "best.ckpt", " train, "):
        assert words in printed


@pytest.mark.slow
def test_a_network_learns_the_drawn_road(recorded: Written, tmp_path: Path) -> None:
    """It beats both baselines on held-out rows, which needs the images."""
    data = (f"data.root={recorded.folder}", "data.split=random", "data.batch_size=16")
    more = ("data.samples_per_epoch=1200", "augment=[]", "trainer.max_epochs=6", "score=none")
    network = ("model=nvidia", "model.dropout=[0,0]")
    succeed(run(tmp_path, *network, *data, *more, "hydra.run.dir=run", timeout=300))
    figures = metrics(tmp_path / "run")
    for baseline in figures["baselines"]["test"].values():
        assert figures["open_loop"]["test"]["mse"] < 0.5 * baseline["mse"]


@pytest.mark.slow
@pytest.mark.parametrize("schedule", ["constant", "cosine"])
def test_a_run_killed_and_resumed_ends_with_the_same_weights(
    schedule: str, recorded: Written, tmp_path: Path
) -> None:
    overrides = (*SMALL, *data_of(recorded), f"schedule={schedule}")
    overrides += ("data.samples_per_epoch=1600", "trainer.max_epochs=8")
    succeed(run(tmp_path, *overrides, "hydra.run.dir=whole"))
    process = start(tmp_path, "zoo", *overrides, "hydra.run.dir=killed")
    try:
        next(line for line in process.stdout if "epoch   4/" in line)
    finally:
        process.kill()
        process.wait()
    assert status(tmp_path / "killed") == "running"
    before = torch.load(tmp_path / "killed/checkpoints/last.ckpt", weights_only=True)["epoch"]
    assert before < 7, "killed too late to show anything"

    succeed(run(tmp_path, "resume=killed"))
    for name in ("best", "last"):
        assert equal(weights(tmp_path / "whole", name), weights(tmp_path / "killed", name))
    ours, theirs = (metrics(tmp_path / name) for name in ("killed", "whole"))
    for key in ("open_loop", "epochs", "best_epoch"):
        assert ours[key] == theirs[key]
    assert read_curves(tmp_path / "killed") == read_curves(tmp_path / "whole"), "epochs were lost"
    assert status(tmp_path / "killed") == "finished"


def test_ctrl_c_saves_and_prints_how_to_resume(recorded: Written, tmp_path: Path) -> None:
    endless = (*SMALL, *data_of(recorded), "trainer.max_epochs=100000")
    process = start(tmp_path, "zoo", *endless, "hydra.run.dir=run")
    try:
        next(line for line in process.stdout if "epoch   2/" in line)
        process.send_signal(signal.SIGINT)
        printed = process.communicate(timeout=60)[0]
    finally:
        process.kill()
    assert process.returncode == 130
    line = printed.strip().splitlines()[-1]
    assert line.startswith("drivezoo train: stopped in epoch ")
    assert line.endswith(f"resume with: drivezoo train resume={tmp_path / 'run'}")
    assert "Traceback" not in printed
    load_checkpoint(tmp_path / "run" / "checkpoints" / "last.ckpt")
    assert status(tmp_path / "run") == "stopped"


@pytest.mark.slow
def test_two_trainings_at_once_on_an_empty_cache_agree(recorded: Written, tmp_path: Path) -> None:
    overrides = (*SMALL, f"data.root={recorded.folder}", "trainer.max_epochs=1")
    processes = [start(tmp_path, "zoo", *overrides) for _ in range(2)]
    for process in processes:
        printed, _ = process.communicate(timeout=120)
        assert process.returncode == 0, printed
    runs = [path.parent for path in tmp_path.glob("outputs/*/*/metrics.json")]
    assert len(runs) == 2, "two runs of the same second share a folder"
    assert equal(weights(runs[0]), weights(runs[1]))
    assert len(list(tmp_path.glob("outputs/cache/*.npy"))) == 3, "one file a camera"


def test_several_recordings_train_together(recorded: Written, tmp_path: Path, zoo: Zoo) -> None:
    second = write_recording(tmp_path / "second", rows=60, cameras=("center",), style="linux")
    both = f"data.root=[{recorded.folder},{second.folder}]"
    printed = succeed(zoo(*SMALL, both, "trainer.max_epochs=1", "hydra.run.dir=run"))
    assert metrics(tmp_path / "run")["data"]["rows"] == 180
    assert "centre camera only" in printed


LOOP = "zoo.training.closed_loop.ClosedLoop"


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("schedule.factor=7", "optim or schedule: "),
        ("+optim.betas=[0.9]", "optim or schedule: "),
        ("+optim.foreach=true", "optim or schedule: "),
        (f"+callbacks.drives={{_target_: {LOOP}, starts: 0}}", "starts=0: must be 1 or more"),
        (
            f"+callbacks.drives={{_target_: {LOOP}, speed: 99}}",
            "speed=99: must be a number in 1..30",
        ),
        ("trainer.max_epochs=many", "max_epochs"),
        ("data.val_share=0", "monitors val/mse"),
        ("callbacks.early_stopping.patience=3", "a part that is not chosen"),
        ("callbacks.best.monitor=val/msee", "did you mean val/mse"),
        ("callbacks.best.mode=max", "monitors val/mse, of which the min is best; set its mode=min"),
        ("callbacks.best={monitor: val/bias, mode: min}", "val/bias, a signed figure: neither "),
        ("callbacks.best={monitor: val/bias, mode: max}", "val/bias, a signed figure: neither "),
        ("callbacks.best.monitor=wxyz", "available: train/loss, val/"),
        ("data.cache=/proc/none", "cannot write the view cache"),
    ],
)
def test_bad_input_gets_one_line(
    override: str, words: str, recorded: Written, tmp_path: Path, zoo: Zoo
) -> None:
    """All faults of recordings and values have tests of their own, where they are found."""
    line = only_line(zoo(*SMALL, *data_of(recorded), "trainer.max_epochs=1", override))
    assert words in line
    for path in tmp_path.glob("outputs/*/*/status.json"):
        assert status(path.parent) == "failed"
        assert read_status(path.parent)["reason"] in line


def test_preview_shows_what_will_be_fed(recorded: Written, tmp_path: Path) -> None:
    arguments = ("data.block_s=0.5", "augment=[brightness,shadow,shift,blur,noise]")
    root = f"data.root={recorded.folder}"
    succeed(run_here(tmp_path, root, *arguments, module="zoo.commands.preview"))
    for name in ("fed_batch", "steering_histogram"):
        assert (tmp_path / "outputs" / "preview" / f"{name}.png").stat().st_size > 10_000
