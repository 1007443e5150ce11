"""Trainings in the tests' process: without callbacks and loggers, or as the command does."""

import json
from dataclasses import replace
from pathlib import Path

import lightning
import torch
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.driving import DrivingData
from datamodules.view import View
from tests.recordings import Written
from zoo.base.compose import compose_config
from zoo.training.build import build_feed, build_module, build_network, build_trainer, load_data
from zoo.training.host_settings import set_up_process
from zoo.training.plan import TrainingPlan, make_plan
from zoo.training.steering_module import SteeringModule


def data_of(recorded: Written) -> tuple[str, str]:
    """Return the overrides of a recording and of its decoded views, which tests share."""
    return f"data.root={recorded.folder}", f"data.cache={recorded.views}"


def train_here(
    recorded: Written,
    folder: Path,
    *overrides: str,
    console: Console | None = None,
    **changes: object,
) -> tuple[SteeringModule, DrivingData]:
    """Train, and return the module and the data; `changes` are fields of the plan."""
    base = (*data_of(recorded), "data.block_s=0.5", "data.gap_s=0.1")
    config = OmegaConf.create(compose_config([*base, *overrides]))
    config.callbacks = config.logger = {}
    data = load_data(config, Console(quiet=True))
    folder.mkdir(exist_ok=True)
    module, data, trainer = planned(config, data, folder, console, **changes)
    trainer.fit(module, datamodule=data)
    return module, data


def module_of(config: DictConfig, view: View) -> SteeringModule:
    """Return the module that a config trains, without a trainer."""
    console = Console(quiet=True)
    network = build_network(config, view, console)
    return build_module(config, network, TrainingPlan(torch.device("cpu")), {}, console)


def planned(
    config: DictConfig,
    data: DrivingData,
    folder: Path,
    console: Console | None = None,
    **changes: object,
) -> tuple[SteeringModule, DrivingData, lightning.Trainer]:
    """Return module, data and trainer, as the command builds them; `changes` as above."""
    console = console or Console(quiet=True)
    network = build_network(config, data.view, console)
    trainer = build_trainer(config, folder, has_validation=True)
    plan = replace(make_plan(config, data, network, trainer, console), **changes)
    module = build_module(config, network, plan, {}, console)
    set_up_process(plan.threads)
    return module, build_feed(data, plan, console), trainer


def weights(run_folder: Path, name: str = "last") -> dict[str, torch.Tensor]:
    return torch.load(run_folder / "checkpoints" / f"{name}.ckpt", weights_only=True)["state_dict"]


def metrics(run_folder: Path) -> dict:
    return json.loads((run_folder / "metrics.json").read_text())


def equal(a: dict[str, torch.Tensor], b: dict[str, torch.Tensor]) -> bool:
    return a.keys() == b.keys() and all(torch.equal(a[key], b[key]) for key in a)


# A training of seconds; the blocks are short, since the recording is.
SMALL = (
    *("model=tiny", "data.crop=[50,0]", "data.block_s=0.5", "data.gap_s=0.1"),
    *("data.batch_size=16", "callbacks=checkpoints", "score=none"),
)
