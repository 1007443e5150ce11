"""Runs and checkpoints of version 0.1, which name classes where they stood then."""

from importlib import import_module
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from datamodules.data_settings import DataSettings
from tests.recordings import Written
from tests.zoo.command_runs import run_here, succeed
from tests.zoo.trainings import SMALL
from zoo.base.compose import compose_config
from zoo.base.entry_points import file_of
from zoo.base.plain_files import mapped
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.runs.allowed_classes import RENAMED
from zoo.runs.run_record import Run
from zoo.runs.saved_config import find_refusals
from zoo.training.build import build_data

EARLIER = {present: earlier for earlier, present in RENAMED.items()}


PRESENT = [name for name in RENAMED.values() if file_of(name.rpartition(".")[0]).is_file()]


@pytest.mark.parametrize("name", PRESENT)
def test_a_present_name_names_a_class(name: str) -> None:
    module, _, kind = name.rpartition(".")
    assert getattr(import_module(module), kind).__module__ == module


def test_a_yaml_file_of_a_user_may_have_an_earlier_name() -> None:
    config = OmegaConf.create(compose_config(["data.root=lake"]))
    config.data._target_ = "datamodules.driving.DrivingData"
    assert isinstance(build_data(config), DataSettings)


@pytest.fixture(scope="module")
def earlier_run(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train for an epoch, and write the names of version 0.1 into config and checkpoints."""
    cwd = tmp_path_factory.mktemp("earlier")
    words = (*SMALL, f"data.root={recorded.folder}", f"data.cache={cwd / 'cache'}", "loss=weighted")
    succeed(run_here(cwd, *words, "trainer.max_epochs=1", "hydra.run.dir=run"))
    run = cwd / "run"
    config = run / ".hydra" / "config.yaml"
    text = config.read_text()
    for present, earlier in EARLIER.items():
        text = text.replace(f"_target_: {present}\n", f"_target_: {earlier}\n")
    config.write_text(text)
    for path in (run / "checkpoints").glob("*.ckpt"):
        contents = torch.load(path, weights_only=True)
        card = contents["drivezoo"]
        card["config"] = mapped(lambda value: EARLIER.get(value, value), card["config"])
        torch.save(contents, path)
    return run


def test_the_config_of_a_run_and_a_checkpoint_has_the_present_names(earlier_run: Path) -> None:
    written = (earlier_run / ".hydra" / "config.yaml").read_text()
    assert "zoo.losses.SteeringWeightedMSE" in written
    assert "zoo.callbacks.progress.TrainingProgress" in written
    config = Run.open(earlier_run).config
    assert config["loss"]["_target_"] == "zoo.models.losses.SteeringWeightedMSE"
    assert list(find_refusals(config)) == []
    config = load_checkpoint(earlier_run).config
    assert config["loss"]["_target_"] == "zoo.models.losses.SteeringWeightedMSE"


def test_a_run_is_resumed(earlier_run: Path) -> None:
    succeed(run_here(earlier_run.parent, "resume=run", "trainer.max_epochs=2"))
    assert Run.open(earlier_run).metrics["epochs"] == 2
