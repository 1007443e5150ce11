"""Check the values of a config before work begins: types, ranges, and keys that nothing takes.

Each value is compared with the annotation of the constructor's argument that it is for.
"""

import inspect
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import NoneType
from typing import Annotated, Any, Literal

from omegaconf import DictConfig, OmegaConf
from pydantic import Field

from datamodules.balance import Count, Least0, Share
from zoo.base.command_keys import choices_of, typed, wanted
from zoo.base.compose import LISTS_ALL, plain_dict
from zoo.base.errors import UsageError, hint
from zoo.base.key_values import convert, is_misplaced_bool, kinds_in
from zoo.models.make_network import BORDER_KEYS
from zoo.training.build import OWN_KEYS, build_data, check_members, construct, takes
from zoo.training.host_settings import AUTO
from zoo.training.run_module import RunModule

TARGET, HYDRA = "_target_", ("_target_", "_partial_", "_convert_", "_recursive_", "_args_")
# Keys that the section's constructor does not take: drivezoo reads them.
OWN = {"model": BORDER_KEYS, "trainer": OWN_KEYS, "optim": ("l2", "backbone_lr", "lr_batch")}
# A seed is multiplied by 1,000,003 in 64 bits.
BOUNDED: dict[str, Any] = {"optim.momentum": Share, "seed": Annotated[int, Field(ge=0, le=10**12)]}
BOUNDED |= dict.fromkeys(("optim.l2", "callbacks.early_stopping.min_delta"), Least0)
WAITS = ("trainer.max_epochs", "schedule.patience", "callbacks.early_stopping.patience")
BOUNDED |= dict.fromkeys(WAITS, Annotated[int, Field(ge=0)])
BOUNDED |= dict.fromkeys(("optim.backbone_lr", "trainer.gradient_clip_val"), Least0 | None)
BOUNDED |= dict.fromkeys(("optim.lr_batch", "trainer.check_val_every_n_epoch"), Count | None)
BOUNDED |= dict.fromkeys(("trainer.accumulate_grad_batches", "schedule.step_size"), Count)
# datamodules.balance shards each batch: Lightning's sampler would shard the batches again.
BOUNDED |= dict.fromkeys(("trainer.use_distributed_sampler", "trainer.barebones"), Literal[False])
ABOVE_0 = Annotated[float, Field(gt=0)]
FACTORS = ("optim.lr", "loss.delta", "loss.weight", "schedule.factor", "schedule.gamma")
BOUNDED |= dict.fromkeys(FACTORS, ABOVE_0) | {"trainer.limit_train_batches": ABOVE_0 | None}
BOUNDED["trainer.val_check_interval"] = ABOVE_0 | Annotated[str, Field(pattern=":")] | None
BOUNDED["model.name"] = Annotated[str, Field(strict=True)]
BOUNDED["callbacks.best.save_top_k"] = Literal[1]  # of several, the newest would be in best.ckpt
BOUNDED["schedule.mode"] = Literal["min", "triangular", "triangular2", "exp_range"]  # of val/mse
# Of another name, the checkpoint would be found by no command.
BOUNDED["callbacks.best.filename"] = Literal["best"]
BOUNDED["callbacks.last.filename"] = Literal["last"]
BOUNDED["callbacks.last.save_weights_only"] = Literal[False]  # resume= needs the optimizer
SET_BY_RUN = dict.fromkeys(("callbacks", "enable_checkpointing"), "callbacks=NAME")
SET_BY_RUN |= {"logger": "logger=NAME", "default_root_dir": "hydra.run.dir=FOLDER"}
SET_BY_RUN["overfit_batches"] = "trainer.limit_train_batches=N"  # which keeps our order of samples
HOLDERS = ("callbacks", "logger", "data.augment")  # of parts, each a mapping or null
PLAIN = {NoneType, bool, int, float, str, list, tuple, dict, Sequence, Mapping}


def check_config(config: DictConfig) -> None:
    """Check the values of a config whose recording may not exist yet; write 1000 for 1e3.

    Raises:
        InputError: a part cannot be imported.
        UsageError: a value has the wrong type or range, or a constructor does not take a key.
    """
    plain = plain_dict(config)
    if plain["trainer"].get("precision") == AUTO:  # not Lightning's, see `choose_precision`
        del plain["trainer"]["precision"]
    for name in SET_BY_RUN.keys() & plain["trainer"].keys():
        raise UsageError(f"trainer.{name}: cannot be set; type {SET_BY_RUN[name]} instead")
    bounded, most = BOUNDED.copy(), plain["trainer"].get("max_epochs")
    if isinstance(most, int) and most > 0:  # without an epoch, schedule=cosine has T_max=0
        bounded["schedule.T_max"] = Count
        bounded["trainer.min_epochs"] = Annotated[int, Field(ge=0, le=most)] | None
    for key, kind in bounded.items():
        section, _, name = key.rpartition(".")
        if name in (values := OmegaConf.select(config, section) or {}):
            value = convert(key, kind, values[name])
            values[name] = value if isinstance(value, int) else values[name]  # of 1e3
    for key, settings in _parts(plain):
        function = construct(key, {TARGET: settings.get(TARGET)}, _partial_=True).func
        if key == "module":
            check_members(key, function, RunModule, RunModule.NEEDED)
        ours = (*HYDRA, *OWN.get(key, ()))
        check_arguments(key, function, {k: v for k, v in settings.items() if k not in ours})
    record = plain["data"].get("record")
    if record and plain["data"]["root"] is None:
        config = config.copy()
        config.data.root = record["out"]
    build_data(config)  # it checks its own values


def check_arguments(key: str, function: Callable[..., Any], given: Mapping[str, Any]) -> None:
    """Raise UsageError for an argument that a function or class does not take.

    Args:
        key: section of the config, for the message.
        function: function or class.
        given: its arguments by name.
    """
    called = function.__init__ if inspect.isclass(function) else function
    parameters = inspect.signature(called).parameters
    for name, value in given.items():
        if name in parameters:
            _check(f"{key}.{name}", _kind(parameters[name], called), value)
        elif not takes(called, name):
            names = [f"{key}.{parameter}" for parameter in parameters if parameter != "self"]
            near = hint(f"{key}.{name}", names, LISTS_ALL)
            raise UsageError(f"{key}.{name}: no such key; {near}")


def _kind(parameter: inspect.Parameter, function: Callable[..., Any]) -> Any:
    """Return a parameter's type; Any where only type checkers import its names."""
    if not isinstance(parameter.annotation, str):
        return parameter.annotation
    try:
        return eval(parameter.annotation, vars(sys.modules[function.__module__]))
    except NameError:
        return Any


def _check(name: str, kind: Any, value: Any) -> None:
    kinds, is_text = kinds_in(kind), isinstance(value, str)
    if kinds <= PLAIN and (not is_text or choices_of(kind)):
        convert(name, kind, value)
    if isinstance(value, int | float | list) and kinds & (PLAIN - {NoneType}) == {str}:
        raise UsageError(f"{name}={typed(value)}: must be {wanted(str)}")
    number = next((number for number in (float, int) if number in kinds), None)
    is_wrong = isinstance(value, float) and not math.isfinite(value)
    if number and (is_wrong or is_misplaced_bool(kind, value) or (is_text and str not in kinds)):
        raise UsageError(f"{name}={typed(value)}: must be {wanted(number)}")


def _parts(node: Mapping[str, Any], key: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield each mapping that names what to construct, with its dotted key; not `data` itself."""
    for name, value in node.items():
        if value and key in HOLDERS and not isinstance(value, Mapping):
            raise UsageError(f"{key}.{name}={typed(value)}: takes keys; {key}.{name}=null drops it")
        if isinstance(value, Mapping) and value:
            dotted = f"{key}.{name}".lstrip(".")
            if dotted != "data" and (TARGET in value or key in HOLDERS):
                yield dotted, value
            yield from _parts(value, dotted)
