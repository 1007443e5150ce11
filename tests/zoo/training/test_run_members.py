"""The user's own module, datamodule and training step, as `docs/extending.md` shows them."""

import sys
from pathlib import Path
from typing import get_type_hints

import lightning
import pytest
import torch

from datamodules.data_settings import DataSettings
from datamodules.driving import DrivingData
from datamodules.run_data import RunData
from tests.contracts.outside_package import write_manual_examples
from tests.recordings import Written
from tests.slow_members import slow
from tests.zoo.base.user_parts import NETWORK, write_network
from tests.zoo.command_runs import Zoo, only_line, run, succeed
from tests.zoo.trainings import SMALL, data_of, metrics
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint, read_checkpoint_file
from zoo.runs.run_record import Run
from zoo.training.build import check_members
from zoo.training.run_module import RunModule
from zoo.training.steering_module import SteeringModule

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
    files = ("my_parts.py", "conf/data/centre.yaml", "conf/module/plain.yaml")
    write_manual_examples(tmp_path, *files)
    (tmp_path / "stranger.py").write_text(STRANGER)
    (tmp_path / "conf" / "module" / "stranger.yaml").write_text("_target_: stranger.Stranger\n")
    return tmp_path


@pytest.mark.parametrize(
    ("keys", "usual"),
    [
        (("parts=my_parts.py", "data=centre", "augment=[]", "module=plain"), SHORT),
        *slow((("parts=my_parts.py", "data=centre", "augment=[]", "model=nvidia"), SHORT[1:])),
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


TRAINING = ("my_training.py", "conf/module/my_training.yaml", "conf/callbacks/ema.yaml")
NAMED = "parts=[my_net.py,my_training.py]"
CHOSEN = ("model=my_net", "module=my_training", "callbacks=ema")
# In training a second column, for the speed.
AUXILIARY = NETWORK.replace("shape[2], 1", "shape[2], 2").replace(
    "return self.head((images / 255).mean(2).flatten(1))",
    "outputs = self.head((images / 255).mean(2).flatten(1))\n"
    "        return outputs if self.training else outputs[:, :1]",
)


@pytest.fixture(scope="module")
def trained(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train with the manual's part, and return the folder of the files and the run."""
    folder = tmp_path_factory.mktemp("own_training")
    write_network(folder, AUXILIARY)
    write_manual_examples(folder, *TRAINING)
    usual = [word for word in SMALL if not word.startswith(("model=", "callbacks="))]
    keys = ("module.rise=4", "callbacks.ema.decay=0.9", "trainer.max_epochs=2", "hydra.run.dir=run")
    plots = ("fed_batch", "steering_histogram", "predicted_against_true")
    keys += tuple(f"callbacks.{name}=null" for name in plots)
    succeed(run(folder, NAMED, *CHOSEN, *usual, *data_of(recorded), *keys))
    return folder


def test_the_optimizer_the_schedule_and_the_average_are_in_the_checkpoint(trained: Path) -> None:
    saved = read_checkpoint_file(trained / "run" / "checkpoints" / "last.ckpt")
    (group,) = saved["optimizer_states"][0]["param_groups"]
    assert group["weight_decay"] == 0.01
    steps = saved["global_step"]
    assert saved["lr_schedulers"][0]["last_epoch"] == steps > 4, "a step for each batch"
    assert group["lr"] == pytest.approx(0.001 * (1 - steps / (steps + 1)))
    average, current = saved["state_dict"], saved["current_model_state"]
    assert any(not torch.equal(average[name], current[name]) for name in average)


def test_the_network_learns_the_auxiliary_column_and_drives_without_it(
    trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRIVEZOO_PARTS", str(trained / "my_net.py"))
    monkeypatch.syspath_prepend(trained)
    network = load_checkpoint(trained / "run").network
    assert network(torch.zeros(2, 1, 16, 32)).shape == (2, 1)
    assert network.train()(torch.zeros(2, 1, 16, 32)).shape == (2, 2)
    sys.modules.pop("my_net", None)  # other tests have a file of that name


def test_a_resumed_run_needs_the_part(trained: Path) -> None:
    line = only_line(run(trained, "parts=my_net.py", "resume=run", "trainer.max_epochs=3"))
    assert "module._target_='my_training.MyTraining'" in line
    assert "parts=" in line
    succeed(run(trained, NAMED, "resume=run", "trainer.max_epochs=3"))
    assert metrics(trained / "run")["epochs"] == 3


def test_a_class_that_is_no_module_is_refused(trained: Path, recorded: Written) -> None:
    chosen = ("model=my_net", "module=my_training", "module._target_=my_net.MyNet")
    line = only_line(run(trained, NAMED, *chosen, f"data.root={recorded.folder}", "score=none"))
    assert "module: " in line
