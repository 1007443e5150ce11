"""Any sequential network of Keras' layers, such as one that `drivezoo import` converted."""

from dataclasses import replace
from pathlib import Path

from datamodules.view import View
from zoo.base.command_keys import typed
from zoo.base.errors import InputError
from zoo.base.terminal import command_line
from zoo.checkpoints.checkpoint import check_card, find_checkpoint, read_checkpoint_file
from zoo.extras.keras.keras_file import read_keras_apart
from zoo.extras.keras.keras_layers import convert
from zoo.extras.keras.layer_chain import LayerChain
from zoo.extras.keras.network_kind import IMPORTED, network_kind
from zoo.models.make_network import FileNetwork


class Sequential(LayerChain, FileNetwork):
    """A network from plain specs of layers; the values are those of Keras.

    Its layers and its scale are those of the file of its weights where the config has none. The
    arguments are those of `LayerChain`.
    """

    @classmethod
    def file_settings(cls, model: dict, view: View) -> dict:
        """Return the layers and the scale of the file of weights, if no layers are set."""
        if model.get("layers") is not None:
            return {}
        if model["weights"] is None:
            raise InputError(
                "model=keras has no layers of its own; set model.weights=FILE, a .h5, .keras or "
                ".json of Keras or a checkpoint of drivezoo import"
            )
        try:
            path = find_checkpoint(str(model["weights"]))
            read = _of_keras if network_kind(path) in IMPORTED else _of_checkpoint
            layers, scale = read(path, view, model.get("scale"))
        except InputError as error:
            raise InputError(f"model.weights={error}") from None
        return {"layers": layers, "scale": list(scale)}


def _of_keras(path: Path, view: View, scale: list | None) -> tuple[list, list]:
    remedy = "or set what drivezoo import finds"
    try:
        network = convert(read_keras_apart(path), scale=scale)
    except InputError as error:
        raise InputError(f"{error}; here, scale is model.scale; {remedy}") from None
    rows, columns, channels = network.input_shape
    if network.input_shape != view.shape:
        raise InputError(
            f"{path}: its input is {rows} x {columns} x {channels}, the view gives "
            f'{" x ".join(map(str, view.shape))}; set "data.crop=[0,0]" '
            f'"model.size=[{rows},{columns}]" model.colour={"gray" if channels == 1 else "rgb"}, '
            f"with the crop and the colour of its training, {remedy}"
        )
    if network.scale is None:
        raise InputError(
            f'{path}: does not tell how it scales pixels; set "model.scale=[127.5,1]" for '
            f"pixel / 127.5 - 1, or [1,0] for none, {remedy}"
        )
    return network.layers, list(network.scale)


def _of_checkpoint(path: Path, view: View, scale: list | None) -> tuple[list, list]:
    card = read_checkpoint_file(path)["drivezoo"]
    check_card(card, path)
    model, stored = card["config"]["model"], View.from_dict(card["view"])
    if not isinstance(model.get("layers"), list):
        raise InputError(
            f"{path}: is a checkpoint of {model.get('name')!s:.60}, without model.layers; set "
            "model to its name"
        )
    if replace(stored, frame=view.frame) != view:  # the recording has not been read yet
        keys = [f"data.crop={typed(stored.crop)}", f"model.colour={stored.colour}"]
        keys += [f"model.size={typed(stored.size)}", f"model.resize={stored.resize}"]
        raise InputError(f"{path}: was trained on another view; set {command_line(keys)}")
    return model["layers"], scale or model.get("scale") or [127.5, 1.0]
