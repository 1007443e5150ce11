"""A training in this process, without callbacks and loggers."""

from pathlib import Path

from omegaconf import OmegaConf
from rich.console import Console

from datamodules.driving import DrivingData
from tests.recordings import Written
from zoo.build import build_data, build_module, build_trainer
from zoo.config import compose_config
from zoo.pace import set_pace
from zoo.steering_module import SteeringModule


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
