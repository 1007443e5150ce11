"""A Keras model as it is in its file: layers, configs and weights; and the reader of its config.

The config, of Keras 1, 2 or 3, is JSON from an untrusted file: nothing in it is called, and a wrong
type is an error.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from zoo.base.errors import InputError
from zoo.base.limits import is_ordinary
from zoo.base.rig import DONKEYCAR_OUTPUTS

GRAPHS = ("Model", "Functional")  # classes of a model whose layers name their inputs
MOST_LAYERS = 1000
THROTTLE_RANGE = 0.8  # MODEL_CATEGORICAL_MAX_THROTTLE_RANGE in Donkeycar's `cfg_complete.py`


@dataclass(frozen=True)
class KerasLayer:
    """A layer of a file.

    Attributes:
        name: its name in the file.
        kind: its class; empty if the file has no architecture.
        config: its config.
        arrays: its weights in Keras' order, float32.
        constants: numbers that an operator of a functional model was called with, such as
            `127.5` of `x / 127.5`.
        children: layers of a nested model; empty for a plain layer.
        output: position among the model's outputs, if it has several.
    """

    name: str
    kind: str
    config: dict
    arrays: Sequence[np.ndarray] = ()
    constants: tuple[float, ...] = ()
    children: tuple["KerasLayer", ...] = ()
    output: int | None = None

    def leaves(self) -> Iterator["KerasLayer"]:
        """Yield the plain layers, nested models' layers in their place."""
        if not self.children:
            yield self
        for child in self.children:
            yield from child.leaves()


@dataclass(frozen=True)
class KerasModel:
    """A model's layers in the order of the data, nested models' layers in their place.

    Attributes:
        path: file that the user named.
        version: Keras' major version; 1 if the file does not name it, as in Keras itself.
        backend: `tensorflow`, `theano` ...; empty before Keras 1.2, which did not save it.
        layers: layers; without an architecture those with weights. Several outputs are one dense
            layer.
        has_architecture: whether the layers' classes and configs are known.
        outputs: name and number of units of each output, if there are several.
    """

    path: Path
    version: int
    backend: str
    layers: list[KerasLayer]
    has_architecture: bool
    outputs: dict[str, int] = field(default_factory=dict)

    @property
    def input_shape(self) -> list:
        """Return the shape of an image in the first layers' configs; empty if they have none."""
        for layer in self.layers[:3]:
            for key in ("batch_input_shape", "batch_shape"):
                shape = layer.config.get(key)
                if isinstance(shape, list) and len(shape) > 1:
                    return shape[1:]
        return []

    @property
    def is_donkeycar(self) -> bool:
        """Return whether it is a network of Donkeycar, which sees pixels / 255 of RGB frames."""
        return list(self.outputs or (self.layers[-1].name,)) in DONKEYCAR_OUTPUTS


def read_architecture(model: object, source: object, as_chain: bool = True) -> KerasLayer:
    """Return a model with its layers in the order of the data.

    Args:
        model: parsed config of a whole model.
        source: file, for messages.
        as_chain: whether to refuse a model that is no chain; else the file's order is kept.

    Raises:
        InputError: it is no sequential chain of layers; names the layer that is not.
    """
    root = _layer(model, source, as_chain, depth=0)
    if not root.children:
        raise InputError(
            f"{source}: its architecture is {root.kind or 'empty'!s:.60}, not a Sequential or "
            "functional model; save the model with model.save('model.h5')"
        )
    if sum(1 for _ in root.leaves()) > MOST_LAYERS:
        raise InputError(f"{source}: has more than {MOST_LAYERS} layers; name another file")
    return root


def _layer(entry: object, source: object, as_chain: bool, depth: int) -> KerasLayer:
    entry = entry if isinstance(entry, dict) else {}
    kind, config = entry.get("class_name"), entry.get("config")
    is_model = kind == "Sequential" or kind in GRAPHS
    layers = config.get("layers") if isinstance(config, dict) else config
    no_layers = is_model and (not isinstance(layers, list) or not layers)
    if not isinstance(kind, str) or no_layers or depth > 16:
        what = f"{kind} without layers" if no_layers else "without classes of layers"
        raise InputError(f"{source}: its architecture is damaged ({what}); copy or save it again")
    settings = config if isinstance(config, dict) else {}
    name = settings.get("name", entry.get("name", ""))
    name = name if isinstance(name, str) else ""
    if not is_model or not isinstance(layers, list):
        return KerasLayer(name, kind, settings, constants=_constants(entry.get("inbound_nodes")))
    children = [_layer(layer, source, as_chain, depth + 1) for layer in layers]
    if kind in GRAPHS and as_chain:
        children = _chain(children, layers, settings, source)
    if shape := settings.get("build_input_shape"):  # of a model that was built by its first call
        start = {"batch_input_shape": shape} | children[0].config
        children[0] = replace(children[0], config=start)
    return KerasLayer(name, kind, settings, children=tuple(children))


def _chain(
    layers: list[KerasLayer], entries: list[dict], config: dict, source: object
) -> list[KerasLayer]:
    """Return a functional model's layers in the order of the data, several outputs at the end."""
    only = "only a chain of layers, with one input, and dense outputs at its end, can be converted"
    inputs, outputs = (_sources(config.get(f"{key}_layers")) for key in ("input", "output"))
    if len(inputs) > 1:
        names = ", ".join(sorted(inputs))
        raise InputError(f"{source}: the model has {len(inputs)} inputs ({names:.200}); {only}")
    after: dict[str, KerasLayer] = {}
    ends: list[KerasLayer] = []
    starts = set()  # layers whose outputs the several outputs take
    for layer, entry in zip(layers, entries, strict=True):
        inputs = _sources(entry.get("inbound_nodes")) or [""]
        if len(outputs) > 1 and layer.name in outputs and layer.kind == "Dense":
            ends.append(replace(layer, output=outputs.index(layer.name)))
            starts |= set(inputs)
            continue
        if len(inputs) > 1 or inputs[0] in after:
            other = f", as does {after[inputs[0]].name}" if inputs[0] in after else ""
            raise InputError(
                f"{source}: {layer.kind} {layer.name} takes the output of "
                f"{', '.join(inputs) or 'nothing'!s:.200}{other}; {only}"
            )
        after[inputs[0]] = layer
    chain: list[KerasLayer] = []
    while (following := after.pop(chain[-1].name if chain else "", None)) is not None:
        chain.append(following)
    if after:
        names = ", ".join(layer.name for layer in after.values())
        raise InputError(f"{source}: the input does not lead to {names:.200}; {only}")
    if len(ends) != (len(outputs) > 1) * len(outputs) or starts - {chain[-1].name}:
        names = ", ".join(sorted(outputs))
        raise InputError(f"{source}: the model has {len(outputs)} outputs ({names:.200}); {only}")
    return [*chain, *ends]


def joined_outputs(
    layers: list[KerasLayer], source: object
) -> tuple[list[KerasLayer], dict[str, int]]:
    """Return layers with several outputs as one dense layer, and each output's number of units.

    A softmax is left out: the bin of the largest value is the same without it.

    Raises:
        InputError: the outputs differ in their activation, or their weights are not dense layers'.
    """
    placed = {layer.output: layer for layer in layers if layer.output is not None}
    if not placed:
        return layers, {}
    ends = [placed[output] for output in sorted(placed)]
    names = ", ".join(end.name for end in ends)
    activations = [str(end.config.get("activation") or "linear") for end in ends]
    is_donkeycar = [end.name for end in ends] == DONKEYCAR_OUTPUTS[-1]
    binned = is_donkeycar and set(activations) == {"softmax"}
    same = len(set(activations)) == 1 and (binned or "softmax" not in activations)
    dense = all(
        [array.ndim for array in end.arrays] == [2, 1] and end.arrays[1].size for end in ends
    )
    if not same or not dense:
        raise InputError(
            f"{source}: its outputs {names:.200} cannot be converted: each needs a kernel, a bias "
            f"and the same activation, not {', '.join(activations):.200}"
        )
    arrays = [np.concatenate([end.arrays[part] for end in ends], axis=-1) for part in (0, 1)]
    config = {"units": arrays[1].size, "activation": "linear" if binned else activations[0]}
    joined = KerasLayer(names, "Dense", config, arrays)
    units = {end.name: end.arrays[1].size for end in ends}
    return [*(layer for layer in layers if layer.output is None), joined], units


def _sources(node: object, depth: int = 0) -> list[str]:
    """Return the names of layers that a node of the config refers to, in Keras 1, 2 or 3."""
    if depth > 16:
        return []
    if isinstance(node, dict):
        history = node.get("keras_history")
        if isinstance(history, list) and history and isinstance(history[0], str):
            return [history[0]]
        inner: list = list(node.values())
    elif isinstance(node, list):
        if len(node) >= 3 and isinstance(node[0], str) and isinstance(node[1], int):
            lists = [_sources(entry, depth + 1) for entry in node[3:]]
            return [node[0], *(name for names in lists for name in names)]
        inner = node
    else:
        return []
    return [name for child in inner for name in _sources(child, depth + 1)]


def _constants(nodes: object) -> tuple[float, ...]:
    """Return the numbers that follow the tensor in an operator's call; none if it is not first."""
    node = nodes[0] if isinstance(nodes, list) and len(nodes) == 1 else None
    while isinstance(node, list) and node and isinstance(node[0], list):
        node = node[0]
    values: list = []
    if isinstance(node, list) and len(node) == 4 and isinstance(node[3], dict):  # Keras 2
        values = list(node[3].values())
    elif isinstance(node, dict):
        arguments, keywords = node.get("args"), node.get("kwargs")
        if isinstance(arguments, list) and arguments and isinstance(arguments[0], dict):
            values = [*arguments[1:], *(keywords.values() if isinstance(keywords, dict) else ())]
    return tuple(float(value) for value in values if is_ordinary(value))
