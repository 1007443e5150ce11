"""Two processes train what one does, and end together."""

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import lightning
import numpy as np
import psutil
import pytest
import torch
from omegaconf import OmegaConf
from rich.console import Console

from tests.recordings import Written
from tests.zoo.command_runs import command, environment, run, run_words, succeed
from tests.zoo.trainings import data_of, module_of, weights
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.runs.status import read_status
from zoo.training.build import load_data
from zoo.training.conclusion import read_curves
from zoo.training.distributed import ending_together
from zoo.training.open_loop import open_loop_metrics, predict_steering
from zoo.training.plan import make_plan
from zoo.training.run import run_experiment

# 267 samples: the last of 15 batches has one, of which one process gets none; the others are odd.
# LeNet has no dropout, whose draws differ from process to process. Adam would divide a gradient
# near 0 by its own size, and so turn its rounding error into a step of the full learning rate.
SETTINGS = (
    *("model=lenet", "data.block_s=0.5", "data.gap_s=0.1", "data.batch_size=19"),
    *("augment=[brightness,shadow,shift,blur]", "loss=weighted", "optim=sgd"),
    *("score=none", "logger=csv", "callbacks=published"),
)
# Sums in another order, in single precision, through 30 steps: 0.00000001 was measured.
TOLERANCE = 1e-6


class Kept(lightning.Callback):
    """Write this rank's validation figures to a file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def on_validation_end(self, trainer: lightning.Trainer, module: lightning.LightningModule):
        figures = {name: float(value) for name, value in trainer.callback_metrics.items()}
        seen = sum(len(batch["targets"]) for batch in trainer.val_dataloaders.dataset)
        np.savez(self.folder / f"{trainer.global_rank}.npz", *module.validation, seen, figures)


def validate_together(root: str, folder: str) -> None:
    """Fork two ranks, which write `RANK.npz`; also validate alone and write `one.npz`.

    There is a folder for 2 rows and one for 50. Run this in a separate process.
    """
    config = OmegaConf.create(compose_config([*SETTINGS, root, "data.cache=null"]))
    data = load_data(config, Console(quiet=True))
    module = module_of(config, data.view)
    for rows in (2, 50):
        data.split = replace(data.split, val=data.split.train[:rows])
        out = Path(folder) / str(rows)
        out.mkdir()
        predicted = predict_steering(module, data.evaluation_batches("val"))
        true = data.recording.steering[data.split.val].astype(np.float32)
        figures = {f"val/{key}": value for key, value in open_loop_metrics(predicted, true).items()}
        np.savez(out / "one.npz", predicted, true, rows, figures)
        ranks = {"accelerator": "cpu", "devices": 3, "strategy": "ddp_fork"}
        without = ("logger", "enable_progress_bar", "use_distributed_sampler")
        trainer = lightning.Trainer(callbacks=[Kept(out)], **ranks, **dict.fromkeys(without, False))
        trainer.validate(module, datamodule=data, verbose=False)


def test_processes_that_validate_share_the_rows_and_all_have_the_figures_of_one(
    recorded: Written, tmp_path: Path
) -> None:
    arguments = (f"data.root={recorded.folder}", str(tmp_path))
    succeed(run(tmp_path, *arguments, module="tests.zoo.training.test_distributed"))
    for rows in (2, 50):
        predicted, true, _, figures = arrays(tmp_path / str(rows) / "one.npz")
        ranks = [arrays(tmp_path / str(rows) / f"{rank}.npz") for rank in range(3)]
        assert sum(int(seen) for _, _, seen, _ in ranks) == rows, "each row once"
        for own_predicted, own_true, _, own_figures in ranks:
            # A row's sums depend, in the last bits, on how many others are in its batch.
            np.testing.assert_allclose(own_predicted, predicted, rtol=0, atol=1e-6)
            assert own_true.tolist() == true.tolist()
            assert own_figures.item() == pytest.approx(figures.item(), abs=1e-6)
            assert own_figures.item() == ranks[0][3].item(), "to the bit, in all processes"


def arrays(path: Path) -> list[np.ndarray]:
    with np.load(path, allow_pickle=True) as file:
        return list(file.values())


@pytest.mark.slow
def test_two_processes_come_to_the_same_as_one(recorded: Written, tmp_path: Path) -> None:
    more = [*SETTINGS, f"data.root={recorded.folder}", "trainer.max_epochs=2"]
    config = OmegaConf.create(compose_config([*more, "trainer=cpu", f"data.cache={tmp_path}/c"]))
    threads = torch.get_num_threads()
    run_experiment(config, tmp_path / "one")
    torch.set_num_threads(threads)
    result = run(tmp_path, *more, "trainer=ddp_cpu", "hydra.run.dir=two")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.count(" train, ") == 1, "one process speaks"
    single, two = (weights(tmp_path / name) for name in ("one", "two"))
    assert single.keys() == two.keys()
    for name in single:
        torch.testing.assert_close(two[name], single[name], rtol=0, atol=TOLERANCE)
    curves = [read_curves(tmp_path / name) for name in ("one", "two")]
    for name, curve in curves[0].items():
        assert curves[1][name] == pytest.approx(curve, rel=1e-5), name


@pytest.mark.slow
def test_when_a_process_dies_the_first_says_so_in_a_line_and_ends(
    recorded: Written, tmp_path: Path
) -> None:
    root = (f"data.root={recorded.folder}", "trainer=ddp_cpu", "trainer.max_epochs=5000")
    words = command("zoo", *SETTINGS, *root, "hydra.run.dir=run")
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    first = subprocess.Popen(words, cwd=tmp_path, env=environment(), **streams)
    try:
        until = time.monotonic() + 90
        while not (tmp_path / "run" / "checkpoints" / "last.ckpt").is_file():
            assert first.poll() is None, "it goes on"
            assert time.monotonic() < until, "no epoch was complete"
            time.sleep(0.1)
        (second,) = psutil.Process(first.pid).children()
        second.kill()
        _, error = first.communicate(timeout=60)
    finally:
        first.kill()
    assert first.returncode == 1
    assert error.count("\n") == 1, error
    assert "process 2 of the 2 that train together ended (SIGKILL)" in error
    assert "resume with: drivezoo train resume=" in error
    assert read_status(tmp_path / "run")["status"] == "failed"


def test_more_processes_than_samples_in_a_batch_are_refused(recorded: Written) -> None:
    keys = [*SETTINGS, *data_of(recorded), "data.batch_size=1"]
    data = load_data(OmegaConf.create(compose_config(keys)), Console(quiet=True))
    with pytest.raises(InputError, match=r"data\.batch_size=1 .* 2 processes .*; set it to 2"):
        make_plan(None, data, None, Others(), None)


class Others:
    """A stand-in for a trainer with two processes."""

    world_size, global_rank = 2, 0

    def __init__(self, rank: int = 0) -> None:
        self.global_rank, self.is_global_zero = rank, rank == 0
        self.callbacks: list[lightning.Callback] = []


def ended(how: str) -> subprocess.Popen:
    process = subprocess.Popen([sys.executable, "-c", how])
    process.wait()
    return process


def lose(folder: Path, other: subprocess.Popen) -> None:
    """Raise, as the first process's training does, when the second process has ended."""
    trainer = Others()
    with ending_together(trainer, folder, "GO ON"):
        trainer.callbacks[0].others = [other]
        raise RuntimeError("gloo: Connection closed by peer")


@pytest.mark.parametrize(
    ("how", "end"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "SIGKILL"),
        ("raise SystemExit(3)", "exit status 3"),
    ],
)
def test_an_error_for_want_of_another_process_is_said_as_its_end(
    tmp_path: Path, how: str, end: str
) -> None:
    with pytest.raises(InputError, match=rf"process 2 of the 2 .* ended \({end}\).*GO ON"):
        lose(tmp_path, ended(how))


def test_a_process_that_is_not_the_first_leaves_its_reason_to_that(tmp_path: Path) -> None:
    second = Others(rank=1)
    with pytest.raises(SystemExit) as stopped, ending_together(second, tmp_path, "GO ON"):
        raise InputError("its disk is full")
    assert stopped.value.code == 0
    with pytest.raises(InputError, match="its disk is full"):
        lose(tmp_path, ended(""))


def test_an_error_of_our_own_is_not_hidden(tmp_path: Path) -> None:
    for trainer in (Others(), Others(rank=1)):
        with pytest.raises(KeyError), ending_together(trainer, tmp_path, "GO ON"):
            raise KeyError("a bug")


@pytest.mark.slow
def test_a_process_that_waits_for_ever_is_ended(tmp_path: Path) -> None:
    """With NCCL the main thread gets no error when the other process ends."""
    source = (
        "import time, zoo.training.distributed as together\n"
        "from pathlib import Path\n"
        "from tests.zoo.training.test_distributed import ended\n"
        "together.GRACE_S = 0.2\n"
        f"watch = together.Watch(Path({str(tmp_path)!r}), 'GO ON')\n"
        "watch.others = [ended('raise SystemExit(3)')]\n"
        "watch._start(watch._failed_other)\n"
        "time.sleep(60)\n"
    )
    result = run_words(tmp_path, sys.executable, "-c", source)
    assert result.returncode == 1
    assert "process 2 of the 2 that train together ended (exit status 3)" in result.stderr
    assert read_status(tmp_path)["status"] == "failed"


if __name__ == "__main__":
    validate_together(*sys.argv[1:])
