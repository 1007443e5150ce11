"""Trainings in this process: without callbacks and loggers, or as the command runs them."""

from pathlib import Path

import pytest
from omegaconf import OmegaConf
from rich.console import Console

from datamodules.driving import DrivingData
from tests.recordings import Written
from zoo.__main__ import zoo
from zoo.cli.compose import compose_config
from zoo.cli.run_command import run_command
from zoo.training.build import build_data, build_module, build_trainer
from zoo.training.plan import set_pace
from zoo.training.steering_module import SteeringModule


def train_here(
    recorded: Written,
    folder: Path,
    *overrides: str,
    together: int | None = None,
    console: Console | None = None,
) -> tuple[SteeringModule, DrivingData]:
    """What was trained, and on what; with `together`, on so many batches at a time."""
    base = (
        f"data.root={recorded.folder}",
        f"data.cache={folder / 'cache'}",
        "data.block_s=0.5",
        "data.gap_s=0.1",
    )
    config = OmegaConf.create(compose_config([*base, *overrides]))
    config.callbacks = config.logger = {}
    data = build_data(config)
    data.load(Console(quiet=True))
    module = build_module(config, data, {})
    folder.mkdir(exist_ok=True)
    trainer = build_trainer(config, folder, has_validation=True)
    set_pace(config, module, data, trainer, console or Console(quiet=True))
    if together:
        data.batches_together = together
    trainer.fit(module, datamodule=data)
    return module, data


# Small enough for seconds; blocks as short as the recording asks for.
SMALL = (
    "model=tiny",
    "data.crop=[50,0]",
    "data.block_s=0.5",
    "data.gap_s=0.1",
    "data.batch_size=16",
    "callbacks=published",
    "score=none",
)


def zoo_here(monkeypatch: pytest.MonkeyPatch, cwd: Path, *arguments: str) -> int:
    """Return the exit status of `python -m zoo ARGUMENTS`, run in this process: torch is there."""
    monkeypatch.chdir(cwd)
    monkeypatch.setattr("sys.argv", ["zoo", *arguments])
    return run_command("zoo", zoo, list(arguments))
