"""A Keras model as it is in its file: layers, configs and weights; and the reader of its config.

The config, of Keras 1, 2 or 3, is JSON from an untrusted file: nothing in it is called, and a wrong
type is an error.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from zoo.base.errors import InputError
from zoo.base.limits import is_ordinary

GRAPHS = ("Model", "Functional")  # classes of a model whose layers name their inputs
MOST_LAYERS = 1000


@dataclass(frozen=True)
class KerasLayer:
    """A layer of a file.

    Attributes:
        name: its name in the file.
        kind: its class; empty if the file has no architecture.
        config: its config.
        arrays: its weights in Keras' order, float32.
        constants: numbers that an operator of a functional model was called with.
    """

    name: str
    kind: str
    config: dict
    arrays: list[np.ndarray]
    constants: tuple[float, ...] = ()


@dataclass(frozen=True)
class KerasModel:
    """A model's layers in the order of the data, nested models' layers in their place.

    Attributes:
        path: file that the user named.
        version: Keras' major version; 1 if the file does not name it, as in Keras itself.
        backend: `tensorflow`, `theano` ...; empty before Keras 1.2, which did not save it.
        layers: layers; without an architecture those with weights.
        has_architecture: whether the layers' classes and configs are known.
    """

    path: Path
    version: int
    backend: str
    layers: list[KerasLayer]
    has_architecture: bool


@dataclass(frozen=True)
class LayerConfig:
    """A layer's name, class and config, as in the file.

    Attributes:
        children: layers of a nested model; empty for a plain layer.
        constants: numbers that an operator of a functional model was called with, such as
            `127.5` of `x / 127.5`.
    """

    name: str
    kind: str
    config: dict
    children: tuple["LayerConfig", ...] = ()
    constants: tuple[float, ...] = ()

    def leaves(self) -> Iterator["LayerConfig"]:
        """Yield the plain layers, nested models' layers in their place."""
        if not self.children:
            yield self
        for child in self.children:
            yield from child.leaves()


def read_architecture(model: object, source: object, as_chain: bool = True) -> LayerConfig:
    """Return a model with its layers in the order of the data.

    Args:
        model: parsed config of a whole model.
        source: file, for messages.
        as_chain: whether to refuse a model that is no chain; else the file's order is kept.

    Raises:
        InputError: it is no sequential chain of layers; names the layer that is not.
    """
    found = _layer(model, source, as_chain, depth=0)
    if not found.children:
        raise InputError(
            f"{source}: its architecture is {found.kind or 'empty'!s:.60}, not a Sequential or "
            "functional model; save the model with model.save('model.h5')"
        )
    if sum(1 for _ in found.leaves()) > MOST_LAYERS:
        raise InputError(f"{source}: has more than {MOST_LAYERS} layers; name another file")
    return found


def _layer(entry: object, source: object, as_chain: bool, depth: int) -> LayerConfig:
    if not isinstance(entry, dict) or depth > 16:
        raise InputError(f"{source}: its architecture is damaged; copy or save it again")
    kind, config = entry.get("class_name"), entry.get("config")
    if not isinstance(kind, str):
        raise InputError(f"{source}: a layer of its architecture has no class; save it again")
    layers = config.get("layers") if isinstance(config, dict) else config
    own = config if isinstance(config, dict) else {}
    name = own.get("name", entry.get("name", ""))
    name = name if isinstance(name, str) else ""
    if kind == "Sequential" or kind in GRAPHS:
        if not isinstance(layers, list) or not layers:
            raise InputError(f"{source}: {kind} {name} has no layers; save the model again")
        children = [_layer(one, source, as_chain, depth + 1) for one in layers]
        if kind in GRAPHS and as_chain:
            children = _chain(children, layers, own, source)
        if shape := own.get("build_input_shape"):  # of a model that was built by its first call
            start = {"batch_input_shape": shape} | children[0].config
            children[0] = replace(children[0], config=start)
        return LayerConfig(name, kind, own, tuple(children))
    return LayerConfig(name, kind, own, constants=_constants(entry.get("inbound_nodes")))


def _chain(
    layers: list[LayerConfig], entries: list[dict], config: dict, source: object
) -> list[LayerConfig]:
    """Return a functional model's layers in the order of the data."""
    for key, what in (("input_layers", "inputs"), ("output_layers", "outputs")):
        ends = sorted(_sources(config.get(key)))
        if len(ends) > 1:
            raise InputError(
                f"{source}: the model has {len(ends)} {what} ({', '.join(ends)!s:.200}); a network "
                "that drives has one image as input and one list of outputs"
            )
    after: dict[str, LayerConfig] = {}
    starts = []
    for layer, entry in zip(layers, entries, strict=True):
        nodes = entry.get("inbound_nodes")
        inputs = _sources(nodes)
        if isinstance(nodes, list) and len(nodes) > 1:
            raise InputError(f"{source}: {layer.kind} {layer.name} is used more than once{_ONLY}")
        if len(inputs) > 1:
            raise InputError(
                f"{source}: {layer.kind} {layer.name} has {len(inputs)} inputs "
                f"({', '.join(inputs)!s:.200}){_ONLY}"
            )
        if not inputs:
            starts.append(layer)
        elif inputs[0] in after:
            raise InputError(
                f"{source}: {layer.kind} {layer.name} and {after[inputs[0]].name} both take the "
                f"output of {inputs[0]}{_ONLY}"
            )
        else:
            after[inputs[0]] = layer
    if len(starts) != 1:
        raise InputError(f"{source}: the model has {len(starts)} inputs{_ONLY}")
    chain = starts
    while (following := after.pop(chain[-1].name, None)) is not None:
        chain.append(following)
    if len(chain) != len(layers):
        raise InputError(f"{source}: the layers after {chain[-1].name} are not connected{_ONLY}")
    return chain


_ONLY = "; only a chain of layers can be converted"


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
            more = [_sources(one, depth + 1) for one in node[3:]]
            return [node[0], *(name for one in more for name in one)]
        inner = node
    else:
        return []
    return [name for one in inner for name in _sources(one, depth + 1)]


def _constants(nodes: object) -> tuple[float, ...]:
    """Return the numbers that follow the tensor in an operator's call; none if it is not first."""
    node = nodes[0] if isinstance(nodes, list) and len(nodes) == 1 else None
    while isinstance(node, list) and node and isinstance(node[0], list):
        node = node[0]
    values: list = []
    if isinstance(node, list) and len(node) == 4 and isinstance(node[3], dict):  # Keras 2
        values = list(node[3].values())
    elif isinstance(node, dict):
        arguments, more = node.get("args"), node.get("kwargs")
        if isinstance(arguments, list) and arguments and isinstance(arguments[0], dict):
            values = [*arguments[1:], *(more.values() if isinstance(more, dict) else ())]
    return tuple(float(one) for one in values if is_ordinary(one))
