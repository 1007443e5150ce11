"""`trainer.precision=auto`: what it chooses, prints and keeps."""

import copy
import json
from io import StringIO
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf
from rich.console import Console

from datamodules.view import View
from tests.recordings import Written
from tests.zoo.commands import run_here, succeed
from tests.zoo.sweep.test_sweep_command import SMALL
from tests.zoo.trainings import data_of, train_here
from zoo.checkpoints.checkpoint import read_checkpoint_file
from zoo.cli.compose import compose_config
from zoo.models.make_network import make_network, view_of
from zoo.rerun import _keep_precision, _report
from zoo.training import precision

CPU = "trainer.accelerator=cpu"


def network_of(*overrides: str) -> tuple[OmegaConf, torch.nn.Module, View]:
    config = OmegaConf.create(compose_config([CPU, *overrides]))
    view = view_of(config.model, config.data.crop)
    return config, make_network(OmegaConf.to_container(config.model), view), view


@pytest.mark.parametrize(
    ("overrides", "knows", "gain", "before", "chosen", "printed"),
    [
        (("model=lenet",), True, 1.3, None, "bf16-mixed", "a step in bfloat16 is 1.30 times"),
        (("model=lenet",), True, 1.1, None, "32-true", "a step in bfloat16 is 1.10 times"),
        (("model=lenet",), False, None, None, "32-true", ""),
        (("model=lenet",), None, None, None, "32-true", ""),
        (("model=lenet",), True, None, "bf16-mixed", "bf16-mixed", ""),
        (("model=lenet",), True, None, "32-true", "32-true", ""),
        (("model=lenet",), False, None, "an.attacker", "32-true", ""),
        (("model=lenet", "~trainer.precision"), True, None, None, "32-true", ""),
        (("model=lenet", "trainer.precision=32-true"), True, None, "bf16-mixed", "32-true", ""),
        (("model=lenet", "trainer=ddp_cpu"), True, None, None, "32-true", ""),
        (("model=lenet", "trainer.accelerator=gpu"), True, None, None, "32-true", ""),
        (("model=tiny",), True, None, None, "32-true", ""),
    ],
)
def test_what_is_chosen_and_said(
    overrides, knows, gain, before, chosen, printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a gain, measuring one would fail."""
    monkeypatch.setattr(precision, "multiplies_bf16", lambda: knows)
    monkeypatch.setattr(precision, "gain_of_half", lambda *_: gain)
    console = Console(file=StringIO(), width=200)
    config, network, view = network_of(*overrides)
    found = precision.choose_precision(config, network, view, before, console)
    assert found == chosen
    said = console.file.getvalue()
    assert printed in said if printed else said == ""


@pytest.mark.parametrize("model", ["lenet", "ncp", "nvidia_speed"])
def test_measuring_changes_nothing(model: str) -> None:
    _, network, view = network_of(f"model={model}")
    before, state = copy.deepcopy(network.state_dict()), torch.random.get_rng_state()
    assert 0.01 < precision.gain_of_half(network, view) < 100
    assert torch.equal(torch.random.get_rng_state(), state)
    assert all(torch.equal(before[name], one) for name, one in network.state_dict().items())
    assert all(one.grad is None for one in network.parameters())


def test_a_checkpoint_keeps_it_for_a_resumed_run(
    recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = [one for one in SMALL if not one.startswith("model")]
    words = (*small, "model=lenet", *data_of(recorded), "data.samples_per_epoch=48")
    monkeypatch.setattr(precision, "multiplies_bf16", lambda: True)
    monkeypatch.setattr(precision, "gain_of_half", lambda *_: 2.0)
    folder = tmp_path / "run"
    run_dir = f"hydra.run.dir={folder}"
    printed = succeed(run_here(tmp_path, *words, CPU, "trainer.max_epochs=1", run_dir))
    assert "trainer.precision=auto: bf16-mixed" in printed
    assert "plan: bf16-mixed on cpu" in printed
    card = read_checkpoint_file(folder / "checkpoints" / "last.ckpt")["drivezoo"]
    assert (card["precision"], card["config"]["trainer"]["precision"]) == ("bf16-mixed", "auto")
    assert json.loads((folder / "metrics.json").read_text())["precision"] == "bf16-mixed"

    monkeypatch.setattr(precision, "gain_of_half", lambda *_: 0.5)
    printed = succeed(run_here(tmp_path, f"resume={folder}", "trainer.max_epochs=2"))
    assert "plan: bf16-mixed on cpu" in printed
    assert "trainer.precision=auto" not in printed


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
        ends.append(torch.cat([one.detach().flatten() for one in module.network.parameters()]))
    assert float(torch.dist(*ends, order)) == pytest.approx(0.0001, rel=0.02)


@pytest.mark.parametrize(
    ("asked", "then", "knows", "kept"),
    [
        ("auto", "bf16-mixed", True, "bf16-mixed"),
        ("auto", "bf16-mixed", False, "auto"),
        ("auto", "32-true", True, "32-true"),
        ("auto", None, True, "auto"),
        ("auto", "an.attacker", True, "auto"),
        ("16-mixed", "bf16-mixed", True, "16-mixed"),
    ],
)
def test_a_repeated_run_keeps_it_where_the_processor_has_it(
    asked, then, knows, kept, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zoo.rerun.multiplies_bf16", lambda: knows)
    config = OmegaConf.create({"trainer": {"precision": asked}})
    _keep_precision(config, then)
    assert config.trainer.precision == kept


def test_a_repeated_run_in_another_precision_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    _report({"precision": "bf16-mixed"}, {"precision": "32-true", "versions": {}}, tmp_path)
    assert "precision: bf16-mixed then, 32-true now\n" in capsys.readouterr().out
