"""Read the weights of Keras' layers from HDF5, of the layouts of Keras 1, 2 and 3.

The layouts are defined in Keras' `saving/legacy_h5_format.py` (Keras 1, 2; 3's `.h5`) and
`saving/saving_lib.py` (`.weights.h5` in a `.keras` file). Only plain datasets are read: links to
other files, external and virtual datasets are refused.
"""

import itertools
import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from zoo.base.errors import InputError
from zoo.base.limits import check_most, check_unpacked
from zoo.extras.keras.keras_model import KerasLayer

CONTAINERS = ("layers", "_layer_checkpoint_dependencies")  # of Keras 3, and of 2.12 to 2.15
Named = tuple[str, np.ndarray]


class WeightsFile:
    """The arrays of an opened HDF5 file.

    Args:
        file: opened `h5py.File`.
        source: file's name, for messages.
        size: file's bytes, which bound those of the arrays.
    """

    def __init__(self, file: Any, source: object, size: int) -> None:
        self.file, self.source = file, source
        self._size, self._claimed, self._count = size, 0, 0
        self.group = _child(file, "model_weights", source) if "model_weights" in file else file
        self.is_legacy = "layer_names" in self.group.attrs or "layer_names0" in self.group.attrs
        self.is_keras_3 = any(container in file for container in CONTAINERS)

    def attribute(self, name: str) -> str:
        """Return a text that stands with the weights or with the file; empty without one."""
        return text(self.group.attrs.get(name, self.file.attrs.get(name, "")))

    def named_arrays(self) -> list[tuple[str, list[Named]]]:
        """Return each group of the legacy layout with its arrays, in order."""
        groups = []
        for name in names(self.group, "layer_names"):
            group = _child(self.group, name, self.source)
            arrays = [(array, self._array(group, array)) for array in names(group, "weight_names")]
            groups.append((name, arrays))
        return groups

    def arrays_of(self, model: KerasLayer) -> dict[int, list[np.ndarray]]:
        """Return the arrays of each plain layer of a model, by the `id` of its config.

        Raises:
            InputError: a layer's weights are not in the file, or cannot be told from others'.
        """
        if not self.is_legacy:
            return dict(self._keras_3(model, self.file))
        groups = dict(self.named_arrays())
        layer_names = {leaf.name for layer in model.children for leaf in (layer, *layer.leaves())}
        if any(arrays and name not in layer_names for name, arrays in groups.items()):
            return self._in_order(model, groups)
        return {k: v for child in model.children for k, v in self._legacy(child, groups).items()}

    def _legacy(self, layer: KerasLayer, groups: dict) -> dict[int, list[np.ndarray]]:
        arrays = groups.get(layer.name)
        if not layer.children:
            return {} if arrays is None else {id(layer): [array for _, array in arrays]}
        if not arrays:  # Keras 1 writes a nested model's layers beside the others
            return {
                k: v for child in layer.children for k, v in self._legacy(child, groups).items()
            }
        # Keras 2 and 3 write them in one group: first all that are trained, then the others.
        leaves = list(layer.leaves())
        by_leaf: dict[int, list[np.ndarray]] = {id(leaf): [] for leaf in leaves}
        for name, array in arrays:
            owners = [leaf for leaf in leaves if leaf.name in name.split("/")[:-1]]
            if len(owners) != 1:
                raise InputError(
                    f"{self.source}: {name} belongs to no layer, or to several layers, of "
                    f"{layer.kind} {layer.name}; give the layers unique names and save it again"
                )
            by_leaf[id(owners[0])].append(array)
        return by_leaf

    def _in_order(self, model: KerasLayer, groups: dict) -> dict[int, list[np.ndarray]]:
        """Return arrays by the order of layers, as Keras loads weights with other layer names."""
        leaves = list(model.leaves())
        offset = 1 if leaves[0].kind == "InputLayer" and len(groups) == len(leaves) - 1 else 0
        if len(groups) != len(leaves) - offset:
            raise InputError(
                f"{self.source}: holds weights of {', '.join(groups)!s:.200}, the architecture has "
                f"{', '.join(leaf.name for leaf in leaves)!s:.200}; name the weights of this model"
            )
        pairs = zip(leaves[offset:], groups.values(), strict=True)
        return {id(leaf): [array for _, array in arrays] for leaf, arrays in pairs}

    def _keras_3(self, model: KerasLayer, group: Any) -> Iterator[tuple[int, list[np.ndarray]]]:
        container = next((name for name in CONTAINERS if name in group), None)
        if container is None:
            return
        inner = _child(group, container, self.source)
        counts: dict[str, int] = {}
        for layer in model.children:
            key = snake_case(layer.kind)
            number = counts.get(key, 0)
            counts[key] = number + 1
            key = f"{key}_{number}" if number else key
            if key not in inner:
                continue
            child = _child(inner, key, self.source)
            if layer.children:
                yield from self._keras_3(layer, child)
            elif "vars" in child:
                values = _child(child, "vars", self.source)
                order = sorted((value for value in values if value.isdigit()), key=int)
                yield id(layer), [self._array(values, value) for value in order]

    def _array(self, group: Any, name: str) -> np.ndarray:
        """Return a dataset as float32.

        Raises:
            InputError: it is no plain dataset of floats, or too large.
        """
        for part in name.strip("/").split("/"):
            group = _child(group, part, self.source)
        where = f"{self.source}: {name!s:.100}"
        if not hasattr(group, "dtype") or group.dtype.kind not in "fiu":
            raise InputError(f"{where} does not hold numbers; save the model again")
        if group.external or group.is_virtual:
            raise InputError(f"{where} keeps its values in another file; save the model again")
        # Keras does not compress; a filter unpacks whole chunks, of any size.
        if group.id.get_create_plist().get_nfilters():
            raise InputError(f"{where} is compressed, which Keras never does; save the model again")
        count = max(math.prod(group.shape), math.prod(group.chunks or ()))
        self._claimed += count * max(group.dtype.itemsize, 4)
        check_unpacked(self._claimed, self._size, where)
        self._count += 1
        check_most("arrays", self._count, where)
        return np.asarray(group[()]).astype(np.float32)


def _child(group: Any, name: str, source: object) -> Any:
    """Return a group's member that lies in the same file; raise InputError for a link."""
    import h5py

    if not isinstance(group, h5py.Group) or name in ("", ".", ".."):
        raise InputError(f"{source}: {name!s:.100} is not in a group; save the model again")
    link = group.get(name, getlink=True)
    if link is None:
        raise InputError(f"{source}: lacks {name!s:.100}; copy it again, or save the model again")
    if not isinstance(link, h5py.HardLink):
        raise InputError(f"{source}: {name!s:.100} is a link, which is not followed")
    return group[name]


def names(group: Any, attribute: str) -> list[str]:
    """Return the list of names in an attribute; Keras splits a long one into numbered parts."""
    numbered = (f"{attribute}{part}" for part in itertools.count())
    parts = itertools.takewhile(group.attrs.__contains__, numbered)
    attributes = [attribute] if attribute in group.attrs else parts
    return [text(name) for part in attributes for name in group.attrs[part]]


def text(value: bytes | str) -> str:
    """Return a text of HDF5, which h5py returns as bytes or str."""
    return value.decode() if isinstance(value, bytes) else str(value)


def snake_case(name: str) -> str:
    """Return a class's name as Keras 3 writes it in a file.

    >>> [snake_case(name) for name in ("Conv2D", "PReLU", "SeparableConv2D", "BatchNormalization")]
    ['conv2d', 'p_re_lu', 'separable_conv2d', 'batch_normalization']
    """
    name = re.sub(r"\W+", "", name)
    name = re.sub("(.)([A-Z][a-z]+)", r"\1_\2", name)
    return re.sub("([a-z])([A-Z])", r"\1_\2", name).lower()
