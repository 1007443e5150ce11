"""The main job as a person runs it: real recordings, real processes."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

import pytest
import torch
from PIL import Image

from tests.recordings import Written, write_recording
from tests.zoo.command_runs import (
    Zoo,
    command,
    environment,
    only_line,
    run,
    run_here,
    start,
    succeed,
)
from tests.zoo.trainings import SMALL, data_of, equal, weights
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.training.conclusion import read_curves
from zoo.training.resume import resume


def test_a_run_leaves_what_the_design_says(run_folder: Path) -> None:
    assert json.loads((run_folder / "status.json").read_text())["status"] == "finished"
    assert (run_folder / ".hydra" / "config.yaml").is_file()
    assert list(run_folder.glob("events.out.tfevents.*"))
    rows = list(csv.DictReader((run_folder / "metrics.csv").open()))
    for figure in ("val/mse", "train/loss"):
        assert {row["epoch"] for row in rows if row[figure]} == {"0", "1"}
    for name in ("best", "last"):
        assert load_checkpoint(run_folder / "checkpoints" / f"{name}.ckpt").network is not None
    pictures = {
        "fed_batch",
        "steering_histogram",
        "training_curves",
        "predicted_against_true_val",
        "predicted_against_true_test",
    }
    assert {path.stem for path in (run_folder / "plots").glob("*.png")} == pictures
    for name in pictures:
        with Image.open(run_folder / "plots" / f"{name}.png") as picture:
            assert min(picture.size) > 300
            assert len(picture.convert("L").getcolors(256) or []) > 10, "an empty picture"


def test_metrics_stand_beside_both_baselines(run_folder: Path) -> None:
    printed = (run_folder / "stdout.txt").read_text()
    metrics = json.loads((run_folder / "metrics.json").read_text())
    assert metrics["parameters"] == 252_219
    assert set(metrics["open_loop"]) == {"train", "val", "test"}
    for part, figures in metrics["open_loop"].items():
        assert set(figures) == {"mse", "mae", "balanced_mae", "bias"}
        assert set(metrics["baselines"][part]) == {"always zero", "mean"}
    assert set(metrics["side_response"]) == {"val", "test"}
    assert all(-1 < response < 1 for response in metrics["side_response"].values())
    for key in ("samples_per_second", "seconds_per_epoch", "wall_s"):
        assert metrics[key] > 0
    assert metrics["seed"] == 1
    assert metrics["epochs"] == 2
    assert len(metrics["data"]["fingerprint"]) == 16
    assert len(load_checkpoint(run_folder).data["row_hashes"]) == 120
    assert sum(metrics["data"]["split"].values()) <= metrics["data"]["rows"] == 120
    assert metrics["versions"]["torch"] == version("torch")  # without +cpu or +cu130
    assert f"{metrics['open_loop']['test']['mse']:.4f}" in printed
    for words in ("nvidia", "always zero", "mean", "balanced MAE", "best.ckpt", " train, "):
        assert words in printed


@pytest.mark.slow
def test_a_network_learns_the_drawn_road(recorded: Written, tmp_path: Path) -> None:
    """It beats both baselines on held-out rows, which needs the images."""
    succeed(
        run(
            tmp_path,
            "model=nvidia",
            "model.dropout=[0,0]",
            f"data.root={recorded.folder}",
            "data.split=random",
            "data.batch_size=16",
            "data.samples_per_epoch=1200",
            "augment=[]",
            "trainer.max_epochs=6",
            "score=none",
            "hydra.run.dir=run",
            timeout=300,
        )
    )
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    for baseline in metrics["baselines"]["test"].values():
        assert metrics["open_loop"]["test"]["mse"] < 0.5 * baseline["mse"]


@pytest.mark.slow
@pytest.mark.parametrize("schedule", ["constant", "cosine"])
def test_a_run_killed_and_resumed_ends_with_the_same_weights(
    schedule: str, recorded: Written, tmp_path: Path
) -> None:
    overrides = (
        *SMALL,
        f"schedule={schedule}",
        f"data.root={recorded.folder}",
        "data.samples_per_epoch=1600",
        "trainer.max_epochs=8",
    )
    succeed(run(tmp_path, *overrides, "hydra.run.dir=whole"))

    def has_third_epoch() -> bool:
        """Return whether `metrics.csv`, which is written after the checkpoint, has epoch 3."""
        with suppress(InputError):  # read while it is written
            return 3 in read_curves(tmp_path / "killed")["train/loss"]
        return False

    process = subprocess.Popen(
        command("zoo", *overrides, "hydra.run.dir=killed"), cwd=tmp_path, env=environment()
    )
    try:
        until = time.monotonic() + 90
        while not has_third_epoch():
            assert process.poll() is None, "the run ended early"
            assert time.monotonic() < until
            time.sleep(0.05)
    finally:
        process.kill()
        process.wait()
    assert json.loads((tmp_path / "killed" / "status.json").read_text())["status"] == "running"
    before = torch.load(tmp_path / "killed/checkpoints/last.ckpt", weights_only=True)["epoch"]
    assert before < 7, "killed too late to show anything"

    succeed(run(tmp_path, "resume=killed"))
    for name in ("best", "last"):
        assert equal(weights(tmp_path / "whole", name), weights(tmp_path / "killed", name))
    ours, theirs = (
        json.loads((tmp_path / name / "metrics.json").read_text()) for name in ("killed", "whole")
    )
    for key in ("open_loop", "epochs", "best_epoch"):
        assert ours[key] == theirs[key]
    assert read_curves(tmp_path / "killed") == read_curves(tmp_path / "whole"), "epochs were lost"
    assert json.loads((tmp_path / "killed" / "status.json").read_text())["status"] == "finished"


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
    said = printed.strip().splitlines()[-1]
    assert said.startswith("drivezoo train: stopped in epoch ")
    assert said.endswith(f"resume with: drivezoo train resume={tmp_path / 'run'}")
    assert "Traceback" not in printed
    load_checkpoint(tmp_path / "run" / "checkpoints" / "last.ckpt")
    assert json.loads((tmp_path / "run" / "status.json").read_text())["status"] == "stopped"


@pytest.fixture(scope="module")
def once(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train for an epoch, and return the run's folder, which tests must not change."""
    cwd = tmp_path_factory.mktemp("once")
    short = (*data_of(recorded), "trainer.max_epochs=1", "hydra.run.dir=run")
    succeed(run_here(cwd, *SMALL, *short))
    return cwd / "run"


def test_a_loss_that_is_not_finite_stops_and_keeps_the_last_good_checkpoint(
    once: Path, tmp_path: Path, zoo: Zoo
) -> None:
    shutil.copytree(once, tmp_path / "run")
    # Go on with a rate at which weights overflow.
    checkpoint = tmp_path / "run" / "checkpoints" / "last.ckpt"
    contents = torch.load(checkpoint, weights_only=True)
    for group in contents["optimizer_states"][0]["param_groups"]:
        group["lr"] = group["initial_lr"] = 1e38
    contents["lr_schedulers"][0]["_last_lr"] = [1e38, 1e38]
    contents["lr_schedulers"][0]["base_lrs"] = [1e38, 1e38]
    torch.save(contents, checkpoint)
    line = only_line(zoo("resume=run", "trainer.max_epochs=3"))
    assert "the loss is not finite in epoch 2" in line
    assert equal(weights(tmp_path / "run"), weights(once))
    status = json.loads((tmp_path / "run" / "status.json").read_text())
    assert status["status"] == "failed"
    assert "not finite" in status["reason"]


@pytest.mark.slow
def test_two_trainings_at_once_on_an_empty_cache_agree(recorded: Written, tmp_path: Path) -> None:
    overrides = (*SMALL, f"data.root={recorded.folder}", "trainer.max_epochs=1")
    processes = [
        subprocess.Popen(
            command("zoo", *overrides, *more),
            cwd=tmp_path,
            env=environment(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        for more in ([], [])
    ]
    for process in processes:
        assert process.wait(timeout=120) == 0, process.stderr.read()
        process.stderr.close()
    runs = [path.parent for path in tmp_path.glob("outputs/*/*/metrics.json")]
    assert len(runs) == 2, "two runs of the same second share a folder"
    assert equal(weights(runs[0]), weights(runs[1]))
    assert len(list(tmp_path.glob("outputs/cache/*.npy"))) == 3, "one file a camera"


def test_a_read_only_recording_with_an_odd_name_trains(tmp_path: Path, zoo: Zoo) -> None:
    odd = tmp_path / "my laps=1 [a], (b)"
    write_recording(odd, rows=60, style="windows")
    for path in [*odd.rglob("*"), odd]:
        path.chmod(path.stat().st_mode & ~0o222)
    succeed(zoo(*SMALL, f"data.root={odd}", "trainer.max_epochs=1", "hydra.run.dir=run"))
    odd.chmod(0o755)
    (odd / "IMG").chmod(0o755)


def test_several_recordings_train_together(recorded: Written, tmp_path: Path, zoo: Zoo) -> None:
    second = write_recording(tmp_path / "second", rows=60, cameras=("center",), style="linux")
    both = f"data.root=[{recorded.folder},{second.folder}]"
    printed = succeed(zoo(*SMALL, both, "trainer.max_epochs=1", "hydra.run.dir=run"))
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["data"]["rows"] == 180
    assert "centre camera only" in printed


def test_the_weights_of_a_checkpoint_start_another_run(
    run_folder: Path, tmp_path: Path, zoo: Zoo
) -> None:
    config = (run_folder / ".hydra" / "config.yaml").read_text()
    root = next(line for line in config.splitlines() if line.strip().startswith("root:"))
    best = run_folder / "checkpoints" / "best.ckpt"
    blocks = ("data.block_s=0.5", "data.gap_s=0.1", "callbacks=checkpoints")
    start = (f"data.root={root.split(':', 1)[1].strip()}", f"model.weights={best}", *blocks)
    succeed(zoo(*start, "trainer.max_epochs=0", "score=none", "hydra.run.dir=run"))
    assert equal(weights(tmp_path / "run", "best"), weights(run_folder, "best"))


def spoil_steering(folder: Path) -> None:
    log = folder / "driving_log.csv"
    lines = log.read_text().splitlines()
    fields = lines[3].split(",")
    log.write_text("\n".join([*lines[:3], ",".join([*fields[:3], "nan", *fields[4:]])]))


def truncate_an_image(folder: Path) -> None:
    image = sorted((folder / "IMG").glob("left_*.jpg"))[4]
    image.write_bytes(image.read_bytes()[:500])


@pytest.mark.parametrize(
    ("fault", "override", "words"),
    [
        (shutil.rmtree, "seed=1", "no such folder"),
        (spoil_steering, "seed=1", "driving_log.csv, row 4: steering is 'nan'"),
        (truncate_an_image, "seed=1", "driving_log.csv, row 5: "),
        (None, "data.offset=left", "data.offset=left"),
        (None, "schedule.factor=7", "optim or schedule: "),
        (None, "seed=-1", "seed=-1: must be a whole number"),
        (None, "trainer.max_epochs=many", "max_epochs"),
        (None, "data.val_share=0", "monitors val/mse"),
        (None, "callbacks.early_stopping.patience=3", "a part that is not chosen"),
        (None, "callbacks.best.monitor=val/msee", "did you mean val/mse"),
        (None, "callbacks.best.monitor=wxyz", "available: train/loss, val/"),
        (None, "data.cache=/proc/none", "cannot write the view cache"),
        (None, "model.weights=none.ckpt", "none.ckpt"),
    ],
    ids=lambda value: value.__name__ if callable(value) else None,
)
def test_bad_input_gets_one_line(
    fault: Callable | None, override: str, words: str, recorded: Written, tmp_path: Path, zoo: Zoo
) -> None:
    """All faults of recordings and values have tests of their own, where they are found."""
    data = data_of(recorded)
    if fault:
        folder = write_recording(tmp_path / "lake", rows=40).folder
        fault(folder)
        data = (f"data.root={folder}",)
    line = only_line(zoo(*SMALL, *data, "trainer.max_epochs=1", override))
    assert words in line
    for path in tmp_path.glob("outputs/*/*/status.json"):
        status = json.loads(path.read_text())
        assert status["status"] == "failed"
        assert status["reason"] in line


def test_a_bad_image_can_be_skipped(tmp_path: Path, zoo: Zoo) -> None:
    written = write_recording(tmp_path / "lake", rows=60)
    truncate_an_image(written.folder)
    skip = ("data.on_bad_image=skip", "trainer.max_epochs=0", "hydra.run.dir=run")
    printed = succeed(zoo(*SMALL, f"data.root={written.folder}", *skip))
    assert "skipped 1 rows with a bad image" in printed
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["data"]["rows"] == 59


def test_resuming_on_another_recording_is_refused(
    once: Path, recorded: Written, tmp_path: Path, zoo: Zoo
) -> None:
    shutil.copytree(once, tmp_path / "run")
    config = tmp_path / "run" / ".hydra" / "config.yaml"
    shorter = shutil.copytree(recorded.folder, tmp_path / "lake")
    config.write_text(config.read_text().replace(str(recorded.folder), str(shorter)))
    log = shorter / "driving_log.csv"
    log.write_text("\n".join(log.read_text().splitlines()[:-10]))
    line = only_line(zoo("resume=run", "trainer.max_epochs=2"))
    assert "was trained on 120 rows" in line
    assert "now holds 110" in line
    assert equal(weights(tmp_path / "run"), weights(once))


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("model.width=2", "model.width was 1.0 in the finished epochs"),
        ("optim.l2=0.001", "optim.l2 was 0.0 in the finished epochs"),
        ("model=lenet", "a resumed run keeps"),
    ],
)
def test_resuming_as_what_it_was_not_is_refused(once: Path, override: str, words: str) -> None:
    before = weights(once)
    with pytest.raises(InputError, match=re.escape(words)):
        resume(once, ["trainer.max_epochs=2", override])
    assert equal(weights(once), before)


@pytest.mark.skipif(os.name != "posix", reason="limits the size of files")
@pytest.mark.slow
def test_no_disk_space_is_said_in_one_line(recorded: Written, tmp_path: Path) -> None:
    """A limit on the size of files replaces a full disk: writes fail at the same place."""
    arguments = command("zoo", *SMALL, f"data.root={recorded.folder}", "hydra.run.dir=run")
    result = subprocess.run(
        ["bash", "-c", 'ulimit -f 8; trap "" XFSZ; exec "$@"', "bash", *arguments],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert "cannot write the view cache" in only_line(result)
    assert not list(tmp_path.glob("outputs/cache/*.npy"))


def test_preview_shows_what_will_be_fed(recorded: Written, tmp_path: Path) -> None:
    arguments = ("data.block_s=0.5", "augment=[brightness,shadow,shift,blur,noise]")
    root = f"data.root={recorded.folder}"
    succeed(run_here(tmp_path, root, *arguments, module="zoo.commands.preview"))
    for name in ("fed_batch", "steering_histogram"):
        assert (tmp_path / "outputs" / "preview" / f"{name}.png").stat().st_size > 10_000
