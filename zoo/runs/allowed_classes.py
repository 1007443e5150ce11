"""The classes that a saved config may name, by its sections."""

import importlib
import inspect
from collections.abc import Sequence
from dataclasses import dataclass

from zoo.cli.parts import part_class


@dataclass(frozen=True)
class Allowed:
    """The classes that a config's section may name.

    Attributes:
        own: drivezoo's modules; the class must be defined there, not imported.
        names: full names of other packages' classes.
        base: full name of the class that the classes of the user's parts derive from; empty where
            no part may be named.
    """

    own: tuple[str, ...] = ()
    names: frozenset[str] = frozenset()
    base: str = ""


def _of(module: str, names: str) -> frozenset[str]:
    return frozenset(f"{module}.{name}" for name in names.split())


MODULE = "torch.nn.modules.module.Module"
# By the keys above a `_target_`; * stands for any name.
ALLOWED = {
    ("model",): Allowed(own=("zoo.models.*",), base=MODULE),
    ("loss",): Allowed(
        own=("zoo.losses",),
        names=_of("torch.nn", "HuberLoss L1Loss MSELoss SmoothL1Loss"),
        base=MODULE,
    ),
    ("optim",): Allowed(
        names=_of("torch.optim", "Adadelta Adagrad Adam Adamax AdamW NAdam RAdam RMSprop SGD")
    ),
    ("schedule",): Allowed(
        names=_of(
            "torch.optim.lr_scheduler",
            "ConstantLR CosineAnnealingLR CosineAnnealingWarmRestarts ExponentialLR LinearLR "
            "MultiStepLR OneCycleLR PolynomialLR ReduceLROnPlateau StepLR",
        )
    ),
    ("trainer",): Allowed(names=_of("lightning", "Trainer pytorch.Trainer")),
    ("data",): Allowed(own=("datamodules.driving",)),
    # Image transforms that read no file and call no function of the config.
    ("data", "augment", "*"): Allowed(
        own=("datamodules.augment", "datamodules.bend"),
        names=_of(
            "albumentations",
            "AdvancedBlur Blur ChannelDropout ChannelShuffle CLAHE CoarseDropout ColorJitter "
            "Defocus Downscale Emboss Equalize GaussianBlur GaussNoise HueSaturationValue "
            "ImageCompression ISONoise MedianBlur MotionBlur MultiplicativeNoise PlanckianJitter "
            "Posterize RandomBrightnessContrast RandomFog RandomGamma RandomRain RandomShadow "
            "RandomSnow RandomSunFlare RGBShift SaltAndPepper Sharpen ShotNoise Solarize ToGray "
            "ToSepia ZoomBlur",
        ),
        base="albumentations.core.transforms_interface.BasicTransform",
    ),
    ("callbacks", "*"): Allowed(
        own=("zoo.callbacks.*", "zoo.sweep.pruning"),
        names=_of(
            "lightning.pytorch.callbacks",
            "DeviceStatsMonitor EarlyStopping LearningRateMonitor ModelCheckpoint ModelSummary "
            "RichModelSummary RichProgressBar StochasticWeightAveraging Timer TQDMProgressBar",
        ),
        base="lightning.pytorch.callbacks.callback.Callback",
    ),
    # MLflow and Weights & Biases are not here: they send figures to a server of the config.
    ("logger", "*"): Allowed(names=_of("lightning.pytorch.loggers", "CSVLogger TensorBoardLogger")),
}


def is_allowed(place: tuple[str, ...], target: object) -> bool:
    """Return whether a `_target_` below these keys may have this value."""
    for pattern, allowed in ALLOWED.items():
        if len(pattern) == len(place) and all(
            one in ("*", name) for one, name in zip(pattern, place, strict=True)
        ):
            is_known = target in allowed.names or own_class(target, allowed.own) is not None
            return is_known or _is_of_part(target, allowed.base)
    return False


def own_class(target: object, modules: Sequence[str]) -> type | None:
    """Return the class with a full name, if one of the given modules defines it.

    Args:
        target: value of a `_target_`.
        modules: full names; `zoo.models.*` stands for every module of the package.
    """
    if not isinstance(target, str):
        return None
    module, _, name = target.rpartition(".")
    packages = tuple(one[:-1] for one in modules if one.endswith(".*"))
    if module not in modules and not (packages and module.startswith(packages)):
        return None
    try:
        found = getattr(importlib.import_module(module), name, None)
    except (ImportError, ValueError):
        return None
    # Refuse torch's `zoo.models.layers.nn.Sequential`: the module must define the class.
    return found if inspect.isclass(found) and found.__module__ == module else None


def _is_of_part(target: object, base: str) -> bool:
    """Return whether a class of one of the user's parts derives from a class with a full name."""
    found = part_class(target) if base else None
    names = (
        [f"{one.__module__}.{one.__qualname__}" for one in inspect.getmro(found)] if found else []
    )
    return base in names
