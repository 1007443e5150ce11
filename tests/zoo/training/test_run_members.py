"""What a run needs of a module and of a datamodule, as `docs/extending.md` shows it."""

import re
from pathlib import Path
from typing import get_type_hints

import lightning
import pytest

from datamodules.data_settings import DataSettings
from datamodules.driving import DrivingData
from datamodules.run_data import RunData
from tests.recordings import Written
from tests.zoo.command_runs import ROOT, Zoo, only_line, run, succeed
from tests.zoo.trainings import SMALL
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.runs.run_record import Run
from zoo.training.build import check_members
from zoo.training.run_module import RunModule
from zoo.training.steering_module import SteeringModule

NAMES = r"my_parts\.py|conf/data/centre\.yaml|conf/module/plain\.yaml"
BLOCK = re.compile(rf"```(?:python|yaml)\n# (?P<path>{NAMES})\n(?P<text>.*?)```", re.S)
LIGHTNING = "lightning.Lightning"
# A LightningModule that derives from nothing of drivezoo's, with the members that a run needs.
STRANGER = """
import lightning
import torch


class Stranger(lightning.LightningModule):
    train_epochs, train_samples, train_seconds, validation = 0, 0, 0.0, None

    def __init__(self, network, card, optimizer):
        super().__init__()
        self.network, self.card, self.optimizer = network, card, optimizer

    def forward(self, batch):
        return self.network(batch["images"])

    def mean_loss(self):
        return 0.5

    def training_step(self, batch, number):
        return (self(batch)[:, 0] - batch["targets"][:, 0]).square().mean()

    def validation_step(self, batch, number):
        self.log("val/mse", self.training_step(batch, number))

    def configure_optimizers(self):
        return self.optimizer([{"params": list(self.parameters())}])

    def on_save_checkpoint(self, checkpoint):
        checkpoint["drivezoo"] = self.card
"""
SHORT = [word for word in SMALL if not word.startswith("data.")]


@pytest.fixture
def parts(tmp_path: Path) -> Path:
    """Write the manual's files, and a module that derives from Lightning's alone."""
    blocks = list(BLOCK.finditer((ROOT / "docs" / "extending.md").read_text()))
    assert len(blocks) == 3
    for block in blocks:
        path = tmp_path / block["path"]
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text(block["text"])
    (tmp_path / "stranger.py").write_text(STRANGER)
    (tmp_path / "conf" / "module" / "stranger.yaml").write_text("_target_: stranger.Stranger\n")
    return tmp_path


@pytest.mark.parametrize(
    ("keys", "usual"),
    [
        (("parts=my_parts.py", "data=centre", "augment=[]", "module=plain"), SHORT),
        pytest.param(
            *(("parts=my_parts.py", "data=centre", "augment=[]", "model=nvidia"), SHORT[1:]),
            marks=pytest.mark.slow,
        ),
        (("parts=stranger.py", "module=stranger"), SMALL),
    ],
)
def test_a_run_trains_with_the_members_that_it_names(
    keys: tuple, usual: list, parts: Path, recorded: Written
) -> None:
    root, folder = f"data.root={recorded.folder}", "hydra.run.dir=run"
    printed = succeed(run(parts, *usual, *keys, root, "trainer.max_epochs=2", folder))
    assert "epoch   2/2" in printed
    assert "report not written" not in printed
    metrics = Run(parts / "run").metrics
    assert metrics["best_epoch"] in (1, 2)
    assert metrics["open_loop"]["test"]["mse"] > 0
    assert load_checkpoint(parts / "run").data["fingerprint"]


@pytest.mark.parametrize(
    ("key", "names"),
    [
        (f"data._target_={LIGHTNING}DataModule", "load, evaluation_batches"),
        (f"module._target_={LIGHTNING}Module", "mean_loss, on_save_checkpoint"),
        ("module._target_=torch.nn.Linear", "mean_loss, on_save_checkpoint"),
        ("data._target_=torch.utils.data.TensorDataset", "load, evaluation_batches, train_data"),
    ],
)
def test_what_a_class_lacks_is_named_before_anything_is_recorded(
    key: str, names: str, zoo: Zoo, tmp_path: Path
) -> None:
    line = only_line(zoo(*SMALL, key), 1)
    assert key.partition("._target_=")[0] + ": " in line
    assert names in line
    assert "docs/extending.md" in line
    assert not (tmp_path / "outputs" / "recordings").exists()


def test_a_key_that_a_datamodule_does_not_take_is_named(parts: Path, recorded: Written) -> None:
    keys = ("parts=my_parts.py", "data=centre", f"data.root={recorded.folder}")
    line = only_line(run(parts, *SHORT, *keys), 2)
    assert "data.augment: CentreData does not take it" in line


def test_what_load_leaves_out_is_named() -> None:
    with pytest.raises(InputError, match=r"RunData lacks recording, split, view, "):
        check_members("data", RunData(), RunData, RunData.LOADED)


def test_drivezoos_own_classes_have_what_a_run_needs() -> None:
    check_members("data", DrivingData, RunData, [name for name in RunData.NEEDED if name != "load"])
    assert get_type_hints(DataSettings.load)["return"] is DrivingData
    for kind in (RunModule, SteeringModule):
        check_members("module", kind, RunModule, RunModule.NEEDED)
        assert issubclass(kind, lightning.LightningModule)
