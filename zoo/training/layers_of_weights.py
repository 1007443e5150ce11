"""`model=keras`: read the layers and the scale from the file of weights."""

from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from datamodules.view import View
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import find_checkpoint, read_checkpoint_file
from zoo.keras.initial_weights import KERAS_SUFFIXES
from zoo.models.make_network import view_of

TARGET = "zoo.models.sequential.Sequential"


def with_layers(config: DictConfig) -> DictConfig:
    """Return a config whose `model.layers` and `model.scale` are set, from `model.weights`.

    A config of another model, or with layers, is returned as it is.

    Raises:
        InputError: there are no weights, they have no layers, or the view is not theirs.
    """
    model = config.model
    if model.get("_target_") != TARGET or model.get("layers") is not None:
        return config
    if model.weights is None:
        raise InputError(
            "model=keras has no layers of its own; set model.weights=FILE, a .h5, .keras or .json "
            "of Keras or a checkpoint of drivezoo import"
        )
    plain = OmegaConf.to_container(model, resolve=True)
    view = view_of(plain, OmegaConf.to_container(config.data.crop))
    try:
        path = find_checkpoint(str(model.weights))
        read = _of_keras if path.suffix.lower() in KERAS_SUFFIXES else _of_checkpoint
        layers, scale = read(path, view, plain.get("scale"))
    except InputError as error:
        raise InputError(f"model.weights={error}") from None
    config = config.copy()
    config.model.layers, config.model.scale = layers, list(scale)
    return config


def _of_keras(path: Path, view: View, scale: list | None) -> tuple[list, list]:
    from zoo.keras.keras_file import read_keras_apart
    from zoo.keras.keras_layers import convert

    imported = "or run drivezoo import on it, and set model.weights to the checkpoint"
    try:
        found = convert(read_keras_apart(path), scale=scale)
    except InputError as error:
        raise InputError(f"{error}; here, scale is model.scale; {imported}") from None
    rows, columns, channels = found.input_shape
    if found.input_shape != view.shape:
        size = f"data.crop=[0,0] model.size=[{rows},{columns}]"
        colour = "gray" if channels == 1 else "rgb"
        raise InputError(
            f"{path}: its input is {rows} x {columns} x {channels}, the view gives "
            f"{' x '.join(map(str, view.shape))}; set {size} model.colour={colour}, with the crop "
            f"and the colour of its training, {imported}"
        )
    if found.scale is None:
        raise InputError(
            f"{path}: does not tell how it scales pixels; set model.scale=[127.5,1] for "
            f"pixel / 127.5 - 1, or [1,0] for none, {imported}"
        )
    return found.layers, list(found.scale)


def _of_checkpoint(path: Path, view: View, scale: list | None) -> tuple[list, list]:
    if path.suffix.lower() != ".ckpt":
        raise InputError(f"{path}: holds no layers; name a .h5, .keras, .json or .ckpt file")
    card = read_checkpoint_file(path)["drivezoo"]
    config = card.get("config")
    model = config.get("model") if isinstance(config, dict) else None
    if not isinstance(model, dict) or not isinstance(model.get("layers"), list):
        raise InputError(
            f"{path}: is a checkpoint of {(model or {}).get('name')!s:.60}, without model.layers; "
            "set model to its name"
        )
    try:
        own = View.from_dict(card["view"])
    except (KeyError, TypeError, InputError):
        raise InputError(f"{path}: has no view; name another checkpoint") from None
    if own != view:
        size = "null" if own.size is None else f"[{own.size[0]},{own.size[1]}]"
        raise InputError(
            f"{path}: was trained on another view; set data.crop=[{own.crop[0]},{own.crop[1]}] "
            f"model.colour={own.colour} model.size={size} model.resize={own.resize}"
        )
    return model["layers"], scale or model.get("scale") or [127.5, 1.0]
