"""A Keras model as it is in its file: layers, configs and weights."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np


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
