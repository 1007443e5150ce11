"""Every YAML file in `conf` constructs its object, and no number in it may be `true`."""

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from hydra.core.plugins import Plugins
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from datamodules.view import RESIZES
from tests.slow_members import slow_but
from tests.zoo.compositions import composed
from tests.zoo.training.test_config_values import check
from tests.zoo.trainings import module_of
from zoo.base.compose import choices, compose_config, conf_folder, config_groups
from zoo.base.conf_files import choice_files
from zoo.base.errors import InputError, UsageError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.models.make_network import make_network
from zoo.results.suite import read_suite
from zoo.scoring.track_scores import run_options
from zoo.simulator.track_file import read_track
from zoo.simulator.world_settings import WorldSettings
from zoo.training.build import build_data, build_trainer

CONF = conf_folder()
FILES = [path.relative_to(CONF) for path in sorted(CONF.rglob("*.yaml"))]


class Number(NamedTuple):
    """A number or list of numbers in a config, its keys and its section's target."""

    keys: tuple[str, ...]
    value: list | int | float
    target: str | None


@pytest.mark.parametrize("path", FILES, ids=str)
def test_every_yaml_constructs_its_object(path: Path, tmp_path: Path) -> None:
    group, name = path.parent.as_posix(), path.stem
    if group == "track":
        assert read_track(name).length > 0
    elif group == "road":
        assert read_track(f"{name}:1").length > 0
    elif group == "suite":
        assert read_suite(name).drives
    elif path.parts[0] == "world":
        keys = {key: value for key, value in OmegaConf.load(CONF / path).items() if key != "speed"}
        assert WorldSettings(**keys) == WorldSettings()
    elif path.parts[0] == "hydra":
        folders = {"hydra": {"sweep": {"dir": str(tmp_path)}}}
        settings = OmegaConf.create(folders | {"own": OmegaConf.load(CONF / path)}).own
        _import_package_of(settings._target_)
        assert Plugins.instance()._instantiate(settings)
    else:
        _construct(group, name, tmp_path)


@pytest.mark.parametrize("file", choice_files("model").values(), ids=lambda file: file.stem)
def test_the_help_of_a_model_names_every_resize(file: Path) -> None:
    (line,) = re.findall(r"^resize: .*", file.read_text(), re.M)
    assert set(RESIZES) <= set(re.findall(r"\w+", line))


def test_a_recipe_s_key_of_a_callback_that_is_left_out_is_one_line(tmp_path: Path) -> None:
    config = OmegaConf.create(compose_config(["experiment=lenet", "callbacks=published"]))
    with pytest.raises(UsageError, match=r"callbacks\.early_stopping=null"):
        build_trainer(config, tmp_path, has_validation=True)


def test_a_shared_checkpoints_config_trains_without_its_loggers(tmp_path: Path) -> None:
    config = load_checkpoint(find_checkpoint("tiny41")).config
    assert "logger" not in config, "a server's name and password are not shared"
    trainer = build_trainer(OmegaConf.create(config), tmp_path, has_validation=True)
    assert len(trainer.loggers) == 1


def test_an_augmentation_that_a_recipe_sets_can_be_left_out(tmp_path: Path) -> None:
    words = ["experiment=both_tracks", "augment=[brightness]", f"data.root={tmp_path}"]
    config: DictConfig = OmegaConf.create(compose_config(words))
    assert "pose" in config.data.augment, "the recipe sets its keys"
    assert set(build_data(config).augment) == {"brightness"}


def config_of(group: str, name: str) -> dict:
    """Return the config with a choice of a group, which the tests of this file share."""
    choice = f"{group}=[{name}]" if group == "augment" else f"{group}={name}"
    network = ["model=nvidia_gaussian"] if name == "gaussian" else []
    return composed(choice, *network, "data.root=laps")


def numbers(node: dict, *keys: str) -> Iterator[Number]:
    """Yield each number and list of numbers."""
    for key, value in node.items():
        listed = value if isinstance(value, list) else [value]
        if isinstance(value, dict):
            yield from numbers(value, *keys, key)
        elif listed and all(type(number) in (int, float) for number in listed):
            yield Number((*keys, key), value, node.get("_target_"))


def refuse_true(config: dict, entries: list[Number]) -> None:
    """Check that `true` is refused as each of the numbers."""
    for number in entries:
        section = config
        *sections, key = number.keys
        for name in sections:
            section = section[name]
        section[key] = [True, *number.value[1:]] if isinstance(number.value, list) else True
        with pytest.raises(InputError, match=re.compile(f"{key}=\\[?true", re.IGNORECASE)):
            check(config)
        section[key] = number.value


def test_true_is_no_number_in_any_key() -> None:
    config = composed("data.root=laps")
    entries = list(numbers(config))
    assert len(entries) > 20
    refuse_true(config, entries)


# An experiment has no keys of its own: those that it changes are checked.
@pytest.mark.parametrize("group", slow_but({*config_groups()} - {"experiment"}, config_groups()))
def test_true_is_no_number_in_any_key_of_any_choice(group: str) -> None:
    seen = list(numbers(composed("data.root=laps"))) if group == "experiment" else []
    for name in choices(group):
        if (group, name) == ("model", "keras"):
            continue  # its layers are in a file
        config = config_of(group, name)
        check(config)
        listed = [number for number in numbers(config) if group in (*number.keys, "experiment")]
        new = [number for number in listed if number not in seen]  # an earlier choice has the rest
        refuse_true(config, new)
        seen += new


def _construct(group: str, name: str, folder: Path) -> None:
    """Construct those parts of a training that a choice of a group affects."""
    plain = composed("data.root=laps") if group == "." else config_of(group, name)
    config: DictConfig = OmegaConf.create(plain)
    run_options(config.get("score"))
    for settings in (config.get("logger") or {}).values():
        _import_package_of(settings._target_)
    data = build_data(config)
    if group == "model":
        make_network(OmegaConf.to_container(config.model), data.view)
    elif group in ("loss", "optim", "schedule"):
        optimizers = module_of(config, data.view).configure_optimizers()
        assert optimizers["optimizer"].param_groups
    elif name == "gpu":
        instantiate(config.trainer, _partial_=True)  # a whole construction needs a GPU
    else:
        build_trainer(config, folder / "run", has_validation=True)


def _import_package_of(target: str) -> None:
    """Import a target's module; skip the test if its optional package is not installed."""
    extras = {"RayLauncher": "ray", "SlurmLauncher": "submitit", "JoblibLauncher": "joblib"}
    extras |= {"MLFlowLogger": "mlflow", "WandbLogger": "wandb", "OptunaSweeper": "optuna"}
    package = extras.get(target.rpartition(".")[2])
    if package:
        pytest.importorskip(package)
    importlib.import_module(target.rpartition(".")[0])
