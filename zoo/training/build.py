"""Build the objects of an experiment from its config."""

import csv
import inspect
import logging
import re
import warnings
from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import lightning
import torch
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.loggers import CSVLogger
from omegaconf import DictConfig
from rich.console import Console
from torch import nn

from datamodules.data_settings import DataSettings
from datamodules.driving import DrivingData
from datamodules.features import load_features
from datamodules.run_data import RunData
from datamodules.view import View
from zoo.base.command_keys import keys_of
from zoo.base.compose import plain_dict
from zoo.base.errors import InputError, UsageError
from zoo.base.key_values import check_keys
from zoo.base.parts import import_part, part_errors, part_of
from zoo.base.terminal import print_line
from zoo.checkpoints.checkpoint_files import CheckpointFiles
from zoo.models.make_network import VIEW_KEYS, make_network, view_of
from zoo.models.network_facts import facts_of, loss_facts_of
from zoo.runs.allowed_classes import with_present_names
from zoo.training.batch_step import BatchStep
from zoo.training.candidates import mode_of
from zoo.training.captured_step import CapturedGroup
from zoo.training.closed_loop import DROVE, ClosedLoop
from zoo.training.compiled_loss import compiled_loss
from zoo.training.group_step import GroupStep
from zoo.training.host_settings import AUTO, FULL
from zoo.training.initial_weights import load_weights
from zoo.training.optimizer_groups import lr_scale
from zoo.training.plan import TrainingPlan
from zoo.training.run_loggers import naming_arguments
from zoo.training.run_module import RunModule
from zoo.training.steering_module import OWN, SteeringModule

PLACES = ("root", "images", "cache", "split")  # keys of `data` that hold paths
# Keys of `trainer` that are not arguments of Lightning's Trainer.
OWN_KEYS = ("compile", "group_batches")
WINDOW = ("sequence", "stride", "ahead")  # keys of `data` that the network decides
# Keys of `trainer` with which an epoch may end without a validation, and of callbacks, which else
# act after an epoch.
RARER = {"check_val_every_n_epoch", "val_check_interval", "max_steps", "max_time"}
AFTER_EPOCH = ("save_on_train_epoch_end", "check_on_train_epoch_end")


def load_data(config: DictConfig, console: Console) -> RunData:
    """Return the datamodule of a config, with the recording read."""
    settings = build_data(config)
    loaded = settings.load(console)
    data: Any = settings if loaded is None else loaded  # a user's datamodule may load itself
    check_members("data", data, RunData, RunData.LOADED)
    return data


def build_data(config: DictConfig) -> DataSettings | RunData:
    """Return what `data` names, whose `load` returns the datamodule: nothing is read yet."""
    model, data = plain_dict(config.model), with_present_names(plain_dict(config.data))
    settings = {key: v for key, v in data.items() if key not in ("crop", "record")}
    kind = construct("data", {"_target_": data["_target_"]}, _partial_=True).func
    # What the user has not chosen goes only to a datamodule that takes it.
    offered = {key: settings.pop(key) for key in WINDOW if key in settings}
    # A recipe sets keys of augmentations that augment=[...] may then leave out.
    chosen = {
        name: keys
        for name, keys in (data.get("augment") or {}).items()
        if not isinstance(keys, dict) or "_target_" in keys
    }
    settings.pop("augment", None)
    if chosen:
        settings["augment"] = chosen
    crop = data.get("crop", [0, 0])
    offered |= {"view": view_of(model, crop), "crop": crop, "seed": config.seed}
    offered |= {key: model[key] for key in VIEW_KEYS if key in model and key not in settings}
    keys = [key for key in settings if key[0] != "_"]
    if issubclass(kind, DataSettings):
        check_keys([f"data.{key}" for key in keys], keys_of(kind, "data."))
    else:
        check_members("data", kind, RunData, RunData.NEEDED)
    if unknown := [key for key in keys if not takes(kind, key)]:
        raise UsageError(f"data.{unknown[0]}: {kind.__qualname__} does not take it; leave it out")
    places = {key: settings.pop(key) for key in PLACES if key in settings}
    # Hydra would convert the view, a dataclass, to a config.
    make = construct("data", settings, _partial_=True)
    with part_errors(part_of(data["_target_"])):
        return make(**places, **_taken(kind, offered))


def check_members(key: str, owner: object, base: type, names: Sequence[str]) -> None:
    """Raise InputError for members that a run needs and a class or an object lacks.

    Args:
        key: section of the config.
        owner: class, or an object of it, which need not derive from `base`.
        base: class that has the members, or names them; those of Lightning's class above it do
            not count.
        names: needed members.
    """
    kind, absent = owner if inspect.isclass(owner) else type(owner), object()
    values = {name: getattr(owner, name, absent) for name in names}
    bare = {name: (absent, getattr(base.__base__, name, absent)) for name in names}
    missing = [name for name in names if any(values[name] is value for value in bare[name])]
    if missing:
        raise InputError(
            f"{key}: {kind.__module__}.{kind.__qualname__} lacks {', '.join(missing)}, which a run "
            f"needs; see {base.__module__}.{base.__qualname__} and docs/extending.md"
        )


def takes(function: Callable, name: str) -> bool:
    """Return whether a function or a constructor takes an argument of a name."""
    parameters = inspect.signature(function).parameters
    return name in parameters or any(p.kind is p.VAR_KEYWORD for p in parameters.values())


def _taken(kind: Callable, offered: dict[str, object]) -> dict[str, object]:
    """Return those of the arguments that a constructor takes."""
    return {name: value for name, value in offered.items() if takes(kind, name)}


def build_network(
    config: DictConfig, view: View, console: Console, weights: Path | None = None
) -> nn.Module:
    """Return the network with the weights that training begins with.

    Args:
        config: experiment's config.
        view: what the network sees.
        console: console for the line about loaded weights.
        weights: checkpoint of a resumed run, used in place of `model.weights`.
    """
    torch.manual_seed(config.seed)
    network = make_network(plain_dict(config.model), view)
    if weights is not None:
        load_weights(network, str(weights))
    elif source := config.model.get("weights"):
        print_line(console, f"weights: {load_weights(network, str(source))}")
    # The images' layout: weights in another layout would be converted at every step.
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def build_module(
    config: DictConfig,
    network: nn.Module,
    plan: TrainingPlan,
    card: dict,
    console: Console,
) -> RunModule:
    """Return the LightningModule around a network."""
    optim = dict(config.optim)
    l2, slow = optim.pop("l2", 0.0), optim.pop("backbone_lr", None)
    if slow is not None and facts_of(network).backbone is None:
        none = "the network has no pretrained part; set optim.backbone_lr=null"
        raise InputError(f"optim.backbone_lr={slow}: {none}")
    scale = lr_scale(optim["_target_"], optim.pop("lr_batch", None), config.data.get("batch_size"))
    optim |= {"lr": optim["lr"] * scale} if "lr" in optim else {}
    loss = construct("loss", config.loss)
    _check_spread(network, loss)
    chosen = config.get("module") or {"_target_": OWN}
    make = construct("module", chosen, _partial_=True)
    if plan.features and not issubclass(make.func, SteeringModule):
        raise InputError("module: features need SteeringModule; set model.cache_features=false")
    offered = {
        "network": network,
        "loss": loss,
        "optimizer": construct("optim", optim, _partial_=True),
        "schedule": construct("schedule", config.schedule, _partial_=True),
        "l2": l2,
        "backbone_lr": slow and slow * scale,
        "seed": config.seed,
        "card": card,
        "skips_front": plan.features is not None,
        "make_step": step_of(plan, console),
    }
    if size := plan.compiled_batch:
        offered["compile_loss"] = partial(compiled_loss, size=size, console=console)
    with part_errors(part_of(chosen["_target_"])):
        module = make(**_taken(make.func, offered))
    check_members("module", module, RunModule, ("network",))
    if type(module) is SteeringModule:  # a schedule of the user's may need the trainer
        try:
            module.configure_optimizers()  # to report wrong settings before training starts
        except (LookupError, RuntimeError, TypeError, ValueError) as error:
            raise InputError(f"optim or schedule: {error}; correct its settings") from None
    return module


def step_of(plan: TrainingPlan, console: Console) -> Callable[..., BatchStep]:
    """Return the constructor of what a training step does in a plan."""
    if plan.captured_batch:
        return partial(CapturedGroup, size=plan.captured_batch, console=console)
    return GroupStep if plan.batches_per_step > 1 else BatchStep


def _check_spread(network: nn.Module, loss: nn.Module) -> None:
    """Raise InputError if one of network and loss knows a spread and the other does not."""
    predicted, needed = facts_of(network).predicts_spread, loss_facts_of(loss).needs_spread
    if predicted != needed:
        remedy = "loss=gaussian" if predicted else "model=nvidia_gaussian, or loss=mse"
        raise InputError(
            f"loss: {type(loss).__name__} {'needs' if needed else 'cannot train'} a spread, which "
            f"the network {'predicts' if predicted else 'does not predict'}; set {remedy}"
        )


def build_feed(data: RunData, plan: TrainingPlan, console: Console) -> RunData:
    """Return the data with the plan's feed; compute the features that are not cached."""
    features = None
    if plan.features and isinstance(data, DrivingData):
        features = load_features(plan.features, data.views, console)
    return data.with_feed(plan.batch_device, plan.batches_per_step, features)


def build_trainer(config: DictConfig, folder: Path, has_validation: bool) -> lightning.Trainer:
    """Return the Trainer with callbacks and loggers that write in the run's folder."""
    silence_libraries()
    lightnings = {key: value for key, value in config.trainer.items() if key not in OWN_KEYS}
    if lightnings.get("precision") == AUTO:  # not chosen, see `choose_precision`
        lightnings["precision"] = FULL
    callbacks = [
        construct(f"callbacks.{name}", settings, **_when(settings, lightnings.keys()))
        for name, settings in (config.callbacks or {}).items()
        if settings
    ]
    no_rows = None if has_validation else "data.val_share=0"
    if lightnings.get("limit_val_batches") == 0:
        no_rows = "trainer.limit_val_batches=0"
    lost = f"but {no_rows} leaves no validation rows; set another number, or"
    drives = any(isinstance(callback, ClosedLoop) for callback in callbacks)
    for callback in callbacks:
        if isinstance(callback, ModelCheckpoint):
            callback.dirpath = str(folder / "checkpoints")
            if callback.filename == "best" and callback.monitor is None:
                callback.mode = "max"  # has no effect: Lightning tells its state from that of last
        monitor = str(getattr(callback, "monitor", None) or "")
        what = f"{type(callback).__name__} monitors {monitor}"
        if monitor.startswith("val/") and no_rows:
            raise InputError(
                f"{what}, {lost} callbacks.early_stopping=null callbacks.best.monitor=train/loss"
            )
        if monitor.startswith(DROVE) and not drives:
            raise InputError(f"{what}, but nothing drives; add callbacks=closed_loop")
        if monitor == "val/bias":
            raise InputError(f"{what}, a signed figure: neither its least nor its most is best")
        best = mode_of(monitor)
        if (monitor.startswith(DROVE) or best == "min") and getattr(callback, "mode", best) != best:
            raise InputError(f"{what}, of which the {best} is best; set its mode={best} too")
    if no_rows and str((config.schedule or {}).get("_target_")).endswith("ReduceLROnPlateau"):
        raise InputError(f"schedule=plateau follows val/mse, {lost} schedule=constant")
    loggers = [CSVLogger(folder, name="", version="")]
    for name, settings in (config.get("logger") or {}).items():
        if settings:
            named = naming_arguments(name, config, folder)
            unset = {k: v for k, v in named.items() if k == "save_dir" or k not in settings}
            loggers.append(construct(f"logger.{name}", settings, **unset))
    plugins = {} if lightnings.get("plugins") else {"plugins": [CheckpointFiles(callbacks)]}
    made = {"callbacks": callbacks, "logger": loggers, "default_root_dir": str(folder)}
    return construct("trainer", lightnings, **plugins, **made)


def _when(settings: DictConfig, keys: Collection[str]) -> dict[str, bool]:
    """Return arguments with which a callback acts on a figure when it is new, of `trainer`'s keys.

    Where an epoch may end without a validation, its figure is old by then, or not there yet.
    """
    is_late = str(settings.get("monitor")).startswith("val/") and not RARER.isdisjoint(keys)
    return {key: False for key in AFTER_EPOCH if is_late and key in settings}


def keep_earlier_log(trainer: lightning.Trainer, folder: Path, steps: int) -> None:
    """Let CSVLogger append to a stopped run's `metrics.csv`, which it would delete.

    Args:
        trainer: trainer of the resumed run.
        folder: run's folder.
        steps: number of steps before the resumed one; rows of later steps are logged once more.
    """
    path = folder / "metrics.csv"
    if not path.is_file():
        return
    kept = path.rename(folder / f"metrics.{len(list(folder.glob('metrics.*.csv'))) + 1}.csv")
    with kept.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if None not in (*row, *row.values())]
    if rows and "step" in rows[0]:  # else another program wrote it: it stays beside the new one
        log = trainer.loggers[0].experiment  # type: ignore[attr-defined]  # see `build_trainer`
        log.metrics = [row for row in rows if row["step"].isdecimal() and int(row["step"]) < steps]
        log.save()
        kept.unlink()  # only now: a run that is killed before loses no row


def silence_libraries() -> None:
    """Silence library messages that a user cannot act on."""
    # "GPU available: ...", "TPU ...", tips: each process would print them, and the run prints its
    # device itself.
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.WARNING)
    # Advice of Lightning, such as on data loaders without workers: `DrivingData` needs none.
    warnings.filterwarnings("ignore", module=r"lightning\.")
    # Lightning steps the scheduler by epoch after resuming, which torch warns about.
    warnings.filterwarnings("ignore", message=".*Detected call of `lr_scheduler.step")


def construct(key: str, settings: dict | DictConfig, **more: object) -> Any:
    """Call `hydra.utils.instantiate`; name the config's key where it fails."""
    target = settings.get("_target_")
    if target is None:  # as experiment=lenet, which sets a callback's key, with callbacks=published
        raise UsageError(f"{key}: has keys, but no _target_; add {key}=null")
    if part := part_of(target):  # its own errors, in one line
        import_part(part, target.rpartition(".")[0])
    # Hydra resolves ${ in a path even if it is escaped: such paths are passed at the call.
    late = {name: value for name, value in more.items() if isinstance(value, str) and "${" in value}
    more = {name: value for name, value in more.items() if name not in late}
    partial = {"_partial_": True} if late else {}
    try:
        with part_errors(part):
            made = instantiate(settings, **more, **partial, _convert_="all")
            return made(**late) if late else made
    except (InstantiationException, TypeError) as error:  # TypeError: of a key such as _partial_
        cause: BaseException = error
        while isinstance(cause, InstantiationException) and cause.__cause__:
            cause = cause.__cause__
        if isinstance(cause, InputError):
            raise cause from None
        # Of pydantic, what is wrong with which argument.
        words = re.sub(r"(?s)\d+ validation errors? for \w+\s|\[type=.*", "", str(cause))
        raise InputError(f"{key}: {' '.join(words.split())}") from error
