"""`trainer.precision=auto`: what it chooses, prints and keeps."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from torch import nn

from datamodules.view import View
from tests.recordings import Written
from tests.zoo.command_runs import run_here, succeed
from tests.zoo.training.test_sweep_command import SMALL
from tests.zoo.trainings import data_of, equal, metrics, train_here, weights
from zoo.base.compose import compose_config
from zoo.checkpoints.checkpoint import read_checkpoint_file
from zoo.commands.rerun import _report
from zoo.models.make_network import make_network, view_of
from zoo.training import host_settings, precision

CPU = "trainer.accelerator=cpu"
SHORT = (CPU, "data.samples_per_epoch=48", "trainer.max_epochs=1")


def network_of(*overrides: str) -> tuple[DictConfig, nn.Module, View]:
    config = OmegaConf.create(compose_config([CPU, *overrides]))
    view = view_of(config.model, config.data.crop)
    return config, make_network(OmegaConf.to_container(config.model), view), view


@pytest.mark.parametrize(
    ("overrides", "bf16", "before", "chosen", "printed"),
    [
        (("model=nvidia",), True, None, "bf16-mixed", ("26.9 million", "precision=32-true")),
        (("model=commaai",), True, None, "bf16-mixed", ("at least 10 million",)),
        (("model=lenet",), True, None, "32-true", ("1.0 million", "precision=bf16-mixed")),
        (("model=tiny",), True, None, "32-true", ("fewer than 10 million",)),
        (("model=nvidia",), False, None, "32-true", ()),
        (("model=nvidia",), None, None, "32-true", ()),
        (("model=lenet",), True, "bf16-mixed", "bf16-mixed", ()),
        (("model=nvidia",), True, "32-true", "32-true", ()),
        (("model=nvidia",), False, "an.attacker", "32-true", ()),
        (("model=nvidia", "~trainer.precision"), True, None, "32-true", ()),
        (("model=nvidia", "trainer.precision=32-true"), True, "bf16-mixed", "32-true", ()),
        (("model=nvidia", "trainer=ddp_cpu"), True, None, "32-true", ()),
        (("model=nvidia", "trainer.accelerator=gpu"), True, None, "32-true", ()),
    ],
)
def test_network_processor_and_config_choose(
    overrides, bf16, before, chosen, printed, console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(precision, "multiplies_bf16", lambda: bf16)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert precision.choose_precision(*network_of(*overrides), console, before) == chosen
    text = console.file.getvalue()
    assert all(part in text for part in printed) if printed else text == ""


@pytest.mark.parametrize("model", ["lenet", "nvidia", "tiny", "cnn_gru"])
def test_a_choice_leaves_the_network_in_training(model: str, console: Console) -> None:
    """Lightning trains a network in the mode that it is given: in evaluation without dropout."""
    config, network, view = network_of(f"model={model}")
    modes = [module.training for module in network.modules()]
    precision.choose_precision(config, network, view, console, bf16=True)
    assert [module.training for module in network.modules()] == modes
    assert network.training


def test_a_sweep_chooses_for_all_its_machines(console: Console) -> None:
    given = network_of("model=nvidia")
    chosen = [precision.choose_precision(*given, console, bf16=bf16) for bf16 in (True, False)]
    assert chosen == ["bf16-mixed", "32-true"]


def saved(folder: Path) -> str:
    return OmegaConf.load(folder / ".hydra" / "config.yaml").trainer.precision


def test_the_choice_stands_in_every_file_and_is_kept(
    train: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(precision, "multiplies_bf16", lambda: True)
    monkeypatch.setattr(precision, "LEAST_OPERATIONS", 1)
    folder = tmp_path / "run"
    printed = train(*SHORT)
    assert "trainer.precision=auto: bf16-mixed" in printed
    assert "plan: bf16-mixed on cpu" in printed
    card = read_checkpoint_file(folder / "checkpoints" / "last.ckpt")["drivezoo"]
    assert (card["precision"], card["config"]["trainer"]["precision"]) == 2 * ("bf16-mixed",)
    assert metrics(folder)["precision"] == "bf16-mixed"
    assert saved(folder) == "bf16-mixed"

    monkeypatch.setattr(precision, "multiplies_bf16", lambda: False)
    printed = succeed(run_here(tmp_path, f"resume={folder}", "trainer.max_epochs=2"))
    assert "plan: bf16-mixed on cpu" in printed
    assert "trainer.precision=auto" not in printed


def test_the_first_machine_of_a_sweep_chooses_for_the_others(
    recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The record names what the first machine has; this one has no bfloat16."""
    monkeypatch.setattr(precision, "LEAST_OPERATIONS", 1)
    monkeypatch.setattr(precision, "multiplies_bf16", lambda: False)
    monkeypatch.setattr("zoo.training.sweep_record.multiplies_bf16", lambda: True)
    words = (*SMALL, *data_of(recorded), *SHORT, "seed=1,2", "hydra.sweep.dir=sweep")
    succeed(run_here(tmp_path, "-m", *words))
    assert [saved(tmp_path / "sweep" / name) for name in "01"] == 2 * ["bf16-mixed"]


@pytest.mark.slow
def test_load_changes_no_weight(
    train: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(precision, "multiplies_bf16", host_settings.multiplies_bf16)
    for name, busy in (("idle", 0), ("busy", 2)):
        code = [sys.executable, "-c", "while True: pass"]
        others = [subprocess.Popen(code) for _ in range(busy)]
        try:
            train(*SHORT, "model=lenet", f"hydra.run.dir={name}")
        finally:
            for other in others:
                other.kill()
                other.wait()
    assert equal(weights(tmp_path / "idle"), weights(tmp_path / "busy"))


@pytest.mark.parametrize(("algorithm", "order"), [("norm", 2), ("value", torch.inf)])
def test_it_clips_the_gradients_of_a_fused_optimizer(
    algorithm: str, order: float, recorded: Written, tmp_path: Path
) -> None:
    """A step of plain gradient descent with a learning rate of 1 is as long as the gradient."""
    words = ["model=lenet", "optim=sgd", "optim.momentum=0", "trainer.precision=bf16-mixed"]
    words += ["data.batch_size=16", "data.samples_per_epoch=16", "trainer.max_epochs=1"]
    words += [f"+trainer.gradient_clip_algorithm={algorithm}", "trainer.gradient_clip_val=0.0001"]
    ends = []
    for rate in (1e-12, 1.0):
        module, _ = train_here(recorded, tmp_path, CPU, *words, f"optim.lr={rate}")
        ends.append(torch.cat([w.detach().flatten() for w in module.network.parameters()]))
    assert float(torch.dist(*ends, order)) == pytest.approx(0.0001, rel=0.02)


def test_a_repeated_run_in_another_precision_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    _report({"precision": "bf16-mixed"}, {"precision": "32-true", "versions": {}}, tmp_path)
    assert "precision: bf16-mixed then, 32-true now\n" in capsys.readouterr().out
