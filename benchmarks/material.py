"""Recordings of any length for the benchmarks, configs for them, and untrained networks."""

import datetime
from pathlib import Path

import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.driving import DrivingData
from datamodules.view import View
from zoo.base.compose import compose_config
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.engine import Engine
from zoo.simulator.recorder import image_name

OUT = Path("outputs/bench")
LAKE = Path("outputs/recordings/lake")
CACHE = str(OUT / "cache")
DRAWN_ROWS = 400
AUGMENT = "augment=[brightness,shadow,shift]"


def pictures() -> dict[str, list[Path]]:
    """Return images by camera, from the lake that `drivezoo train` recorded, or drawn ones."""
    recorded = sorted(LAKE.glob("**/IMG"))
    folder = recorded[0] if recorded else OUT / "drawn" / "IMG"
    if not folder.is_dir():
        from tests.recordings import write_recording

        write_recording(OUT / "drawn", rows=DRAWN_ROWS)
    cameras = ("center", "left", "right")
    return {camera: sorted(folder.glob(f"{camera}_*.jpg")) for camera in cameras}


def linked_recording(rows: int, cameras: tuple[str, ...] = ("center", "left", "right")) -> Path:
    """Return a recording with a number of rows, whose images link to the same few files."""
    folder = OUT / f"{rows}-{len(cameras)}"
    log = folder / "driving_log.csv"
    if log.is_file():
        return folder
    (folder / "IMG").mkdir(parents=True, exist_ok=True)
    there, start = pictures(), datetime.datetime(2020, 1, 1)
    lines = []
    for row in range(rows):
        moment = start + datetime.timedelta(milliseconds=67 * row)
        names = []
        for camera in there:
            if camera not in cameras:
                names.append("")
                continue
            link = folder / "IMG" / image_name(camera, moment)
            link.unlink(missing_ok=True)
            # Hard links cost what a recording's own files cost; a symbolic link is followed first.
            link.hardlink_to(there[camera][row % len(there[camera])])
            names.append(f"IMG/{link.name}")
        steering = ((row * 37) % 101 - 50) / 100
        lines.append(",".join([*names, f"{steering:.2f}", "0.5", "0", "20.0"]))
    log.write_text("\n".join(lines) + "\n")
    return folder


def ready_to_fit(config: DictConfig, data: DrivingData, folder: Path) -> tuple:
    """Return trainer, module and feed of `drivezoo train`, in a process that is set up for them."""
    from zoo.training.build import build_feed, build_module, build_network, build_trainer
    from zoo.training.host_settings import set_up_process
    from zoo.training.plan import make_plan

    folder.mkdir(parents=True, exist_ok=True)
    console = Console(quiet=True)
    network = build_network(config, data.view, console)
    trainer = build_trainer(config, folder, has_validation=True)
    plan = make_plan(config, data, network, trainer, console)
    module = build_module(config, network, plan, {}, console)
    set_up_process(plan.threads)
    return trainer, module, build_feed(data, plan, console)


def loaded_data(config: DictConfig) -> DrivingData:
    """Return the data of a config, with its views."""
    from zoo.training.build import load_data

    return load_data(config, Console(quiet=True))


def config_for(folder: Path, *overrides: str) -> DictConfig:
    """Return the config of `drivezoo train` without driving at the end."""
    ours = (f"data.root={folder}", f"data.cache={CACHE}", "score=none", *overrides)
    config = OmegaConf.create(compose_config(list(ours)))
    OmegaConf.set_struct(config, True)
    return config


def random_network(name: str) -> tuple[torch.nn.Module, View, dict]:
    """Return the network of `model=name` with random weights, its view and its config."""
    from zoo.models.make_network import make_network, view_of

    config = compose_config([f"model={name}", "model.weights=null"])
    view = view_of(config["model"], config["data"]["crop"])
    return make_network(config["model"], view), view, config


def random_policy(name: str, engine: Engine = "torch") -> CheckpointPolicy:
    """Return the untrained network of `model=name` as a policy on one thread."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    network, view, config = random_network(name)
    policy = CheckpointPolicy(Checkpoint(network.eval(), view, config, {}), engine)
    for _ in range(3):
        policy(np.zeros((160, 320, 3), np.uint8), 0.0)
    return policy
