"""Two processes train what one does, and end together."""

import subprocess
import sys
import time
from pathlib import Path

import lightning
import numpy as np
import psutil
import pytest
import torch
from omegaconf import OmegaConf
from rich.console import Console

from datamodules.balance import BatchKey
from datamodules.driving import DrivingData
from datamodules.errors import InputError
from tests.recordings import Written
from tests.zoo.commands import command, environment, run
from zoo.build import build_data
from zoo.config import compose_config
from zoo.experiment import run_experiment
from zoo.losses import SteeringWeightedMSE
from zoo.outcome import read_curves
from zoo.pace import set_pace
from zoo.status import read_status
from zoo.together import ending_together

# 267 samples: the last of 15 batches has one, of which one process gets none; the others are odd.
# LeNet has no dropout, whose draws differ from process to process.
SETTINGS = (
    "model=lenet",
    "data.block_s=0.5",
    "data.gap_s=0.1",
    "data.batch_size=19",
    "augment=[brightness,shadow,shift,blur]",
    "loss=weighted",
    "score=none",
    "logger=csv",
    "callbacks=published",
)
# Sums in another order, in single precision, through 30 steps of Adam: 0.000004 was measured.
TOLERANCE = 5e-5


def loaded(recorded: Written, tmp_path: Path, *overrides: str) -> DrivingData:
    root = (f"data.root={recorded.folder}", f"data.cache={tmp_path / 'cache'}")
    config = OmegaConf.create(compose_config([*SETTINGS, *root, *overrides]))
    data = build_data(config)
    data.load(Console(quiet=True))
    return data


@pytest.mark.parametrize("world", [2, 3, 4])
@pytest.mark.parametrize("flip", ["0.5", "both"])
def test_shares_put_together_are_the_batch_of_one_process(
    recorded: Written, tmp_path: Path, world: int, flip: str
) -> None:
    """Flips and augmentations too, our own and albumentations'; and where some get nothing."""
    data = loaded(recorded, tmp_path, f"data.flip={flip}", "model.colour=yuv")
    batches = data.training_batches()
    for number, size in enumerate((19, 2, 1)):
        samples = np.arange(3 * size, 4 * size)
        whole = batches[BatchKey(0, number, samples)]
        shares = [batches[BatchKey(0, number, samples, rank, world)] for rank in range(world)]
        for name, tensor in whole.items():
            assert torch.equal(torch.cat([one[name] for one in shares]), tensor), name
        steering = [
            batches.steering(BatchKey(0, number, samples, rank, world)) for rank in range(world)
        ]
        assert (
            np.concatenate(steering).tolist()
            == batches.steering(BatchKey(0, number, samples)).tolist()
        )


def test_the_divisor_of_a_weighted_loss_is_what_it_divides_by() -> None:
    predicted, true = torch.randn(2, 7, 2, generator=torch.Generator().manual_seed(0))
    loss = SteeringWeightedMSE(4.0)
    parts = [slice(0, 3), slice(3, 7)]
    whole = sum(loss(predicted[at], true[at]) * loss.divisor(true[at]) for at in parts)
    assert whole / loss.divisor(true) == pytest.approx(loss(predicted, true))


@pytest.mark.slow
def test_two_processes_come_to_the_same_as_one(recorded: Written, tmp_path: Path) -> None:
    more = [*SETTINGS, f"data.root={recorded.folder}", "trainer.max_epochs=2"]
    config = OmegaConf.create(compose_config([*more, "trainer=cpu", f"data.cache={tmp_path}/c"]))
    threads = torch.get_num_threads()
    run_experiment(config, tmp_path / "one")
    torch.set_num_threads(threads)
    result = run(tmp_path, *more, "trainer=ddp_cpu", "hydra.run.dir=two")
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert result.stdout.count("leak: a val") == 1, "one process speaks"
    one, two = (
        torch.load(tmp_path / name / "checkpoints" / "last.ckpt", weights_only=True)["state_dict"]
        for name in ("one", "two")
    )
    assert one.keys() == two.keys()
    for name in one:
        torch.testing.assert_close(two[name], one[name], rtol=0, atol=TOLERANCE)
    curves = [read_curves(tmp_path / name) for name in ("one", "two")]
    for name, curve in curves[0].items():
        assert curves[1][name] == pytest.approx(curve, rel=1e-4), name


@pytest.mark.slow
def test_when_a_process_dies_the_first_says_so_in_a_line_and_ends(
    recorded: Written, tmp_path: Path
) -> None:
    root = (f"data.root={recorded.folder}", "trainer=ddp_cpu", "trainer.max_epochs=5000")
    first = subprocess.Popen(
        command("zoo", *SETTINGS, *root, "hydra.run.dir=run"),
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        until = time.monotonic() + 90
        while not (tmp_path / "run" / "checkpoints" / "last.ckpt").is_file():
            assert first.poll() is None, "it goes on"
            assert time.monotonic() < until, "no epoch was complete"
            time.sleep(0.1)
        (second,) = psutil.Process(first.pid).children()
        second.kill()
        _, said = first.communicate(timeout=60)
    finally:
        first.kill()
    assert first.returncode == 1
    assert said.count("\n") == 1, said
    assert "process 2 of the 2 that train together ended (SIGKILL)" in said
    assert "go on with: python -m zoo resume=" in said
    assert read_status(tmp_path / "run")["status"] == "failed"


def test_more_processes_than_samples_in_a_batch_are_refused(
    recorded: Written, tmp_path: Path
) -> None:
    data = loaded(recorded, tmp_path, "data.batch_size=1")
    said = "data.batch_size=1 is for all processes together, of which there are 2"
    with pytest.raises(InputError, match=said):
        set_pace(None, None, data, Others(), None)


class Others:
    """A trainer's looks, for what waits for other processes."""

    world_size, global_rank = 2, 0

    def __init__(self, rank: int = 0) -> None:
        self.global_rank, self.is_global_zero = rank, rank == 0
        self.callbacks: list[lightning.Callback] = []


def ended(how: str) -> subprocess.Popen:
    process = subprocess.Popen([sys.executable, "-c", how])
    process.wait()
    return process


def lose(folder: Path, other: subprocess.Popen) -> None:
    """What happens in the first process's training when the second is gone."""
    trainer = Others()
    with ending_together(trainer, folder, "GO ON"):
        trainer.callbacks[0].others = [other]
        raise RuntimeError("gloo: Connection closed by peer")


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "SIGKILL"),
        ("raise SystemExit(3)", "exit status 3"),
    ],
)
def test_an_error_for_want_of_another_process_is_said_as_its_end(
    tmp_path: Path, how: str, said: str
) -> None:
    with pytest.raises(InputError, match=rf"process 2 of the 2 .* ended \({said}\).*GO ON"):
        lose(tmp_path, ended(how))


def test_a_process_that_is_not_the_first_leaves_its_reason_to_that(tmp_path: Path) -> None:
    second = Others(rank=1)
    with pytest.raises(SystemExit) as stopped, ending_together(second, tmp_path, "GO ON"):
        raise InputError("its disk is full")
    assert stopped.value.code == 0
    with pytest.raises(InputError, match="its disk is full"):
        lose(tmp_path, ended(""))
    assert not list(tmp_path.iterdir()), "read and removed"


def test_an_error_of_our_own_is_not_hidden(tmp_path: Path) -> None:
    for trainer in (Others(), Others(rank=1)):
        with pytest.raises(KeyError), ending_together(trainer, tmp_path, "GO ON"):
            raise KeyError("a bug")


def test_a_process_that_waits_for_ever_is_ended(tmp_path: Path) -> None:
    """As with NCCL: the main thread never hears of the other's end."""
    source = (
        "import time, zoo.together as together\n"
        "from pathlib import Path\n"
        "from tests.zoo.test_ddp import ended\n"
        "together.GRACE_S = 0.2\n"
        f"watch = together.Watch(Path({str(tmp_path)!r}), 'GO ON')\n"
        "watch.others = [ended('raise SystemExit(3)')]\n"
        "watch._start(watch._failed_other)\n"
        "time.sleep(60)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", source],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
    )
    assert result.returncode == 1
    assert "process 2 of the 2 that train together ended (exit status 3)" in result.stderr
    assert read_status(tmp_path)["status"] == "failed"
