"""Construct the network that a config names, and return facts about it."""

import inspect
import math
import sys
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import nn
from torch.overrides import TorchFunctionMode
from torch.utils.flop_counter import FlopCounterMode

from datamodules.view import View
from zoo.base.errors import InputError
from zoo.base.parts import Part, part_class, part_errors, part_of, unknown_part
from zoo.models.memory import Memory, frame_outputs
from zoo.models.network_facts import facts_of
from zoo.runs.allowed_classes import ALLOWED, own_class

MOST_PARAMETERS = 1_000_000_000  # VGG16 has 138 million
FRAMES = 2  # of the check of a part: with one, a missing dimension would be broadcast
VIEW_KEYS = ("colour", "size", "resize")
# Least value of a setting, and the one that it stays below.
RANGES = {
    "dropout": (0, 1),
    "width": (0.01, math.inf),
    "neurons": (1, math.inf),
    "units": (1, math.inf),
    "wiring_seed": (0, 2**32),
}
# Keys of a model's config that its constructor does not take.
BORDER_KEYS = (*VIEW_KEYS, "weights", "name", "cache_features")


def view_of(model: dict, crop: Any) -> View:
    """Return the view of a model's config; without `resize`, it resizes by area."""
    return View(crop, model["colour"], model["size"], model.get("resize", "area"))


def published_view(config: dict) -> View:
    """Return the view at which a model is published, from a config that names the model.

    A model with `size: null` is published for the whole frame.
    """
    model = config["model"]
    return view_of(model, config["data"]["crop"] if model["size"] else [0, 0])


class FileNetwork(nn.Module):
    """A network that takes settings from the file of its weights, `model.weights`."""

    @classmethod
    def file_settings(cls, model: dict, view: View) -> dict:
        """Return what the file adds to the network's config; nothing if all is set.

        Args:
            model: section `model` of the config.
            view: network's input.

        Raises:
            InputError: there is no file, it lacks the settings, or its network has another view.
        """
        raise NotImplementedError


def network_class(target: object) -> type[nn.Module]:
    """Return the class that a model's `_target_` names.

    A config can come from an untrusted checkpoint, so the class must be in `zoo.models`, or in a
    part that the user names or has installed.

    Raises:
        InputError: the target is no network of the zoo or of a part.
    """
    kind = own_class(target, ALLOWED["model",].own) or part_class(target)
    if kind is None or not issubclass(kind, nn.Module):
        raise InputError(
            f"model._target_={target!s:.200}: is no network of zoo.models "
            f"(drivezoo models lists them); {unknown_part(target)}"
        )
    return kind


def make_network(model: dict, view: View, most: int = MOST_PARAMETERS) -> nn.Module:
    """Return the network that a model's config names, for a view.

    Args:
        model: section `model` of the config.
        view: network's input.
        most: number of parameters that the network may have.

    Raises:
        InputError: see `network_class`; or the network refuses a setting, or a part's network does
            not work as one.
    """
    target = model.get("_target_")
    part, kind = part_of(target), network_class(target)
    settings = {key: value for key, value in model.items() if key not in ("_target_", *BORDER_KEYS)}
    height, width, channels = view.shape
    shape = (channels, height, width)
    if part is None:
        _check_settings(kind, settings)
    try:
        with LimitedParameters(most), part_errors(part):
            network = kind(shape, **settings)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(str(error)) from None
    if part is not None:
        check_network(network, shape, part)
    return network


def _check_settings(network: type[nn.Module], settings: dict) -> None:
    """Raise InputError for a number that is not as the constructor's default, or out of range."""
    parameters = inspect.signature(network).parameters
    for key, (low, below) in RANGES.items():
        if key not in settings or key not in parameters:
            continue
        usual, value = parameters[key].default, settings[key]
        several = isinstance(usual, tuple)
        numbers = value if several and isinstance(value, list | tuple) else [value]
        kinds = (int,) if type(usual) is int else (int, float)
        if len(numbers) != (len(usual) if several else 1) or not all(
            type(number) in kinds and low <= number < below for number in numbers
        ):
            kind = f"{len(usual)} numbers" if several else "a number"
            kind = "a whole number" if kinds == (int,) else kind
            limits = f"of {low} or more" if below == math.inf else f"from {low} to below {below:,}"
            example = str(list(usual) if several else usual).replace(" ", "")
            raise InputError(f"model.{key}={value}: must be {kind} {limits}, such as {example}")


def check_network(network: nn.Module, shape: tuple[int, int, int], part: Part) -> None:
    """Raise InputError if a network lacks what training and driving need of it.

    Args:
        network: network of the part.
        shape: `(channels, height, width)` of its view.
        part: part that defines it, for messages.
    """
    name = type(network).__name__
    if isinstance(network, Memory):  # its own methods compute the shapes
        return
    facts = facts_of(network)
    inputs = [torch.zeros(FRAMES, *shape)]
    if facts.takes_speed:
        inputs.append(torch.zeros(FRAMES))
    was_training = network.training
    with part_errors(part), torch.no_grad():
        outputs = network.eval()(*inputs)
    network.train(was_training)
    columns = facts.columns
    if not isinstance(outputs, torch.Tensor) or tuple(outputs.shape) != (FRAMES, columns):
        shown = list(outputs.shape) if isinstance(outputs, torch.Tensor) else type(outputs).__name__
        raise InputError(
            f"{part.name}: {name}.forward returns {shown} for {FRAMES} images; return "
            f"[{FRAMES}, {columns}], one row for each image, or correct facts = NetworkFacts(...)"
        )


class LimitedParameters(TorchFunctionMode):
    """A context that refuses a network of more than `most` parameters before it takes memory."""

    def __init__(self, most: int = MOST_PARAMETERS) -> None:
        super().__init__()
        self.most = min(most, MOST_PARAMETERS)
        self.count = 0

    def __torch_function__(
        self, function: Callable, types: object, args: tuple = (), kwargs: dict | None = None
    ) -> object:
        """Count the parameters that layers allocate: each starts as `torch.empty(sizes)`."""
        if function is torch.empty:
            self.count += math.prod(args[0] if isinstance(args[0], Sequence) else args)
            if self.count > self.most:
                raise InputError(
                    f"model: its settings need {self.count:,} parameters or more, the limit is "
                    f"{self.most:,}; set a smaller size or width"
                )
        return function(*args, **(kwargs or {}))


def multiply_adds(network: torch.nn.Module, shape: tuple[int, int, int]) -> int:
    """Return the multiply-adds of convolutions and dense layers for one frame."""
    images, speed = torch.zeros(1, *shape), torch.zeros(1)
    modes = [(module, module.training) for module in network.modules()]
    network.eval()
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        frame_outputs(network, images, speed)
    for module, training in modes:  # a training may begin with this network
        module.training = training
    return counter.get_total_flops() // 2


def paper(network: torch.nn.Module) -> str:
    """Return the first line of the docstring of a network's module, which names its source."""
    text = inspect.getdoc(sys.modules[type(network).__module__])
    return text.splitlines()[0].rstrip(".") if text else "no source named"
