"""The classes that a saved config may name, by its sections."""

import importlib
import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from zoo.base.parts import part_class
from zoo.base.plain_files import mapped


@dataclass(frozen=True)
class Allowed:
    """The classes that a config's section may name.

    Attributes:
        own: drivezoo's modules; the class must be defined there, not imported.
        own_base: full name of the class from which those of `own` derive; empty: any class.
        package: another package's module, whose public classes may be named.
        base: full name of the class from which those of the package derive.
        refused: names of the package's classes that read files, or send to a server.
        part: full name of the class from which those of the user's parts derive; empty where no
            part may be named.
    """

    own: tuple[str, ...] = ()
    own_base: str = ""
    package: str = ""
    base: str = ""
    refused: frozenset[str] = frozenset()
    part: str = ""


MODULE = "torch.nn.modules.module.Module"
TRANSFORM = "albumentations.core.transforms_interface.BasicTransform"
STEERING = "zoo.training.steering_module"
CALLBACK = "lightning.pytorch.callbacks.callback.Callback"
# By the keys above a `_target_`; * stands for any name.
ALLOWED = {
    ("model",): Allowed(own=("zoo.models.*",), part=MODULE),
    ("loss",): Allowed(
        own=("zoo.models.losses",),
        package="torch.nn",
        base="torch.nn.modules.loss._Loss",
        part=MODULE,
    ),
    ("optim",): Allowed(package="torch.optim", base="torch.optim.optimizer.Optimizer"),
    ("schedule",): Allowed(
        package="torch.optim.lr_scheduler",
        base="torch.optim.lr_scheduler.LRScheduler",
    ),
    ("module",): Allowed(own=(STEERING,), part=f"{STEERING}.SteeringModule"),
    ("trainer",): Allowed(package="lightning", base="lightning.pytorch.trainer.trainer.Trainer"),
    ("data",): Allowed(own=("datamodules.data_settings",)),
    ("data", "augment", "*"): Allowed(
        own=("datamodules.augment", "datamodules.bend"),
        package="albumentations",
        base=TRANSFORM,
        part=TRANSFORM,
        # Reference images, a font.
        refused=frozenset({"FDA", "HistogramMatching", "PixelDistributionAdaptation", "TextImage"}),
    ),
    ("callbacks", "*"): Allowed(
        own=("zoo.training.*", "zoo.extras.scale.sweep_pruning"),
        own_base=CALLBACK,
        package="lightning.pytorch.callbacks",
        base=CALLBACK,
        part=CALLBACK,
    ),
    # MLflow and Weights & Biases are not here: they send figures to a server of the config.
    ("logger", "*"): Allowed(
        package="lightning.pytorch.loggers",
        base="lightning.pytorch.loggers.logger.Logger",
        refused=frozenset({"CometLogger", "LitLogger", "MLFlowLogger", "WandbLogger"}),
    ),
}

# Classes that had another name when version 0.1 wrote configs and checkpoints.
RENAMED = {
    "datamodules.driving.DrivingData": "datamodules.data_settings.DataSettings",
    "zoo.callbacks.closed_loop.ClosedLoop": "zoo.training.closed_loop.ClosedLoop",
    "zoo.callbacks.progress.TrainingProgress": "zoo.training.training_progress.TrainingProgress",
    "zoo.callbacks.training_images.FedBatch": "zoo.training.training_images.FedBatch",
    "zoo.callbacks.training_images.PredictedAgainstTrue": (
        "zoo.training.training_images.PredictedAgainstTrue"
    ),
    "zoo.callbacks.training_images.SteeringHistogram": (
        "zoo.training.training_images.SteeringHistogram"
    ),
    "zoo.losses.GaussianNLL": "zoo.models.losses.GaussianNLL",
    "zoo.losses.SteeringWeightedMSE": "zoo.models.losses.SteeringWeightedMSE",
    "zoo.models.sequential.Sequential": "zoo.extras.keras.sequential.Sequential",
    "zoo.sweep.pruning.Pruning": "zoo.extras.scale.sweep_pruning.Pruning",
    "zoo.training.sweep_pruning.Pruning": "zoo.extras.scale.sweep_pruning.Pruning",
}


def with_present_names(config: Any) -> Any:
    """Return a saved config with the present names of the classes in `RENAMED`.

    >>> with_present_names({"loss": {"_target_": "zoo.losses.GaussianNLL"}})
    {'loss': {'_target_': 'zoo.models.losses.GaussianNLL'}}
    """
    return mapped(lambda value: RENAMED.get(value, value) if type(value) is str else value, config)


def is_allowed(keys: tuple[str, ...], target: object) -> bool:
    """Return whether a `_target_` below these keys may have this value."""
    for pattern, allowed in ALLOWED.items():
        if len(pattern) == len(keys) and all(
            key in ("*", name) for key, name in zip(pattern, keys, strict=True)
        ):
            kind = own_class(target, allowed.own)
            if kind is not None and (not allowed.own_base or _derives(kind, allowed.own_base)):
                return True
            if _is_public(target, allowed):
                return True
            return bool(allowed.part) and _derives(part_class(target), allowed.part)
    return False


def public_classes(allowed: Allowed) -> dict[str, type]:
    """Return the public classes of a section's package that a saved config may name."""
    if not allowed.package:
        return {}
    package = importlib.import_module(allowed.package)
    members = {name: getattr(package, name) for name in dir(package)}
    return {
        name: kind
        for name, kind in members.items()
        if not name.startswith("_") and name not in allowed.refused and _derives(kind, allowed.base)
    }


def _is_public(target: object, allowed: Allowed) -> bool:
    """Return whether a text is `PACKAGE.CLASS`; the package is the section's, never the text's."""
    module, _, name = target.rpartition(".") if isinstance(target, str) else ("", "", "")
    return module == allowed.package and name in public_classes(allowed)


def own_class(target: object, modules: Sequence[str]) -> type | None:
    """Return the class with a full name, if one of the given modules defines it.

    Args:
        target: value of a `_target_`.
        modules: full names; `zoo.models.*` stands for every module of the package.
    """
    if not isinstance(target, str):
        return None
    module, _, name = target.rpartition(".")
    packages = tuple(full[:-1] for full in modules if full.endswith(".*"))
    if module not in modules and not (packages and module.startswith(packages)):
        return None
    try:
        kind = getattr(importlib.import_module(module), name, None)
    except (ImportError, ValueError):
        return None
    # Refuse torch's `zoo.models.layers.nn.Sequential`: the module must define the class.
    return kind if inspect.isclass(kind) and kind.__module__ == module else None


def _derives(kind: object, base: str) -> bool:
    """Return whether a class derives from the class with a full name."""
    classes = inspect.getmro(kind) if inspect.isclass(kind) else ()
    return base in [f"{parent.__module__}.{parent.__qualname__}" for parent in classes]
