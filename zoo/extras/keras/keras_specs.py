"""Translate a Keras layer's config to specs of `LayerChain`, for Keras 1, 2 and 3.

Values pass as they are: the network checks them when it is built. None stands for the default.
"""

from typing import Any

from zoo.extras.keras.keras_lambda import FUNCTIONS
from zoo.extras.keras.keras_modules import ACTIVATIONS

Spec = dict[str, Any]


class UnknownValueError(ValueError):
    """An error about a config's value that has no counterpart."""


# The settings of each layer, with Keras 2's names, in the order of a spec.
CONVOLUTION = "strides padding filters kernel_size dilation_rate use_bias"
POOL = "pool_size strides padding"
SETTINGS = {
    "Conv2D": f"{CONVOLUTION} groups",
    "SeparableConv2D": f"{CONVOLUTION} depth_multiplier",
    "DepthwiseConv2D": "strides padding kernel_size dilation_rate use_bias depth_multiplier",
    "Dense": "units use_bias",
    "Flatten": "",
    "Reshape": "target_shape",
    "Permute": "dims",
    "MaxPooling2D": POOL,
    "AveragePooling2D": POOL,
    "GlobalAveragePooling2D": "keepdims",
    "GlobalMaxPooling2D": "keepdims",
    "BatchNormalization": "axis epsilon momentum center scale",
    "ELU": "alpha",
    "LeakyReLU": "alpha",
    "PReLU": "shared_axes",
    "ReLU": "max_value negative_slope threshold",
    "Cropping2D": "cropping",
    "ZeroPadding2D": "padding",
    "Rescaling": "scale offset",
    "Dropout": "rate",
    "SpatialDropout2D": "rate",
    "GaussianNoise": "stddev",
}
# Another name of a setting, in Keras 1 or 3.
OTHER_NAMES = {
    "filters": "nb_filter", "strides": "subsample", "dilation_rate": "atrous_rate",
    "padding": "border_mode", "use_bias": "bias", "units": "output_dim",
    "alpha": "negative_slope", "rate": "p", "stddev": "sigma",
}  # fmt: skip
DEFAULTS = {"padding": "valid", "use_bias": True, "groups": 1, "keepdims": False, "center": True,
            "negative_slope": 0, "threshold": 0}  # fmt: skip
PAIRS = ("kernel_size", "strides", "dilation_rate", "pool_size")  # of an image: rows and columns
WITH_ACTIVATION = ("Conv2D", "SeparableConv2D", "DepthwiseConv2D", "Dense")
# Parts of the names of classes in Keras 1 and of aliases.
OLD_KINDS = {"Atrous": "", "Convolution": "Conv", "AvgPool": "AveragePool", "Pool2D": "Pooling2D",
             "NormalizationV1": "Normalization",
             "NormalizationV2": "Normalization"}  # fmt: skip


def plain_kind(kind: str) -> str:
    """Return a class's name in Keras 2.

    >>> plain_kind("AtrousConvolution2D"), plain_kind("MaxPool2D")
    ('Conv2D', 'MaxPooling2D')
    """
    for old, new in OLD_KINDS.items():
        kind = kind.replace(old, new)
    return kind


def _setting(kind: str, key: str, config: dict) -> Any:
    """Return the value of a setting; None for the default."""
    value = config.get(key)
    value = config.get(OTHER_NAMES.get(key, key)) if value is None else value
    if key == "kernel_size" and value is None and "nb_row" in config:
        value = [config.get("nb_row"), config.get("nb_col")]
    if isinstance(value, dict):  # of Keras 2 for numpy's numbers
        value = value.get("value", value)
    if key in PAIRS and kind.endswith("2D"):
        value = [value, value] if type(value) is int else value
        return None if value == [1, 1] and kind.endswith("Conv2D") and key != PAIRS[0] else value
    if key in (*PAIRS, "axis"):
        return value[0] if isinstance(value, list) and len(value) == 1 else value
    if kind in ("Cropping2D", "ZeroPadding2D"):
        return _edges(value)
    return None if value == DEFAULTS.get(key) or (key == "scale" and value is True) else value


def _edges(value: Any) -> Any:
    """Return `[[top, bottom], [left, right]]`, from one number, two, or Keras 1's four."""
    if type(value) is int:
        return [[value, value], [value, value]]
    if isinstance(value, dict):
        names = ("top_pad", "bottom_pad"), ("left_pad", "right_pad")
        return [[value.get(name, 0) for name in pair] for pair in names]
    if isinstance(value, list) and all(type(side) is int for side in value):
        if len(value) == 2:
            return [[side, side] for side in value]
        if len(value) == 4:
            return [value[:2], value[2:]]
    return value


def _resize(config: dict) -> Spec:
    methods = {"bilinear": "linear", "nearest": "nearest", "area": "area"}
    method = str(config.get("interpolation", "bilinear"))
    keeps = config.get("crop_to_aspect_ratio") or config.get("pad_to_aspect_ratio")
    if method not in methods or keeps:
        raise UnknownValueError(f"its interpolation is {method:.40}, or it keeps the aspect ratio")
    size = [config.get("height"), config.get("width")]
    return {"layer": "Resize", "size": size, "method": methods[method]}


# Orders of axes, of Keras 2 and 1.
ORDERS = {"th": "channels_first", "tf": "channels_last"}
ORDERS |= {order: order for order in ORDERS.values()}
# Layers that change nothing in driving, and need no place in the network.
IDENTITIES = (
    "InputLayer", "ActivityRegularization", "Masking", "Identity", "RandomContrast", "RandomFlip",
    "RandomBrightness", "RandomRotation", "RandomTranslation", "RandomZoom",
)  # fmt: skip
RECURRENT = ("LSTM", "GRU", "SimpleRNN", "RNN", "ConvLSTM2D", "Bidirectional", "TimeDistributed")
_ACTIVATIONS = {"silu": "swish", "hard_silu": "hard_swish"}


def specs_of(kind: str, config: dict, version: int) -> list[Spec] | None:
    """Return the specs of a Keras layer; None for an unknown class.

    Args:
        kind: its class in the file.
        config: its config in the file.
        version: Keras' major version.

    Raises:
        UnknownValueError: a setting has no counterpart.
    """
    if kind in IDENTITIES:
        return []
    kind = plain_kind(kind)
    if kind == "Softmax":
        axis = {"axis": config["axis"]} if config.get("axis", -1) != -1 else {}
        return [{"layer": "Activation", "activation": "softmax", **axis}]
    if kind == "Activation":
        return activation_specs(config.get("activation"), version)
    if kind not in (*SETTINGS, "Resizing"):
        return None
    if kind == "BatchNormalization" and config.get("mode") not in (None, 0):
        raise UnknownValueError(f"its mode is {config['mode']!s:.20}, not 0")
    keys = SETTINGS.get(kind, "").split()
    spec: Spec = {"layer": kind} | {key: _setting(kind, key, config) for key in keys}
    if kind == "Resizing":
        spec = _resize(config)
    if ORDERS.get(str(config.get("data_format", config.get("dim_ordering")))) == "channels_first":
        spec["data_format"] = "channels_first"
    after = []
    if kind in WITH_ACTIVATION:
        after = activation_specs(config.get("activation"), version)
        if len(after) == 1 and [*after[0]] == ["layer", "activation"]:
            spec["activation"], after = after[0]["activation"], []
    return [{key: value for key, value in spec.items() if value is not None}, *after]


def operator_specs(name: str, constants: tuple[float, ...]) -> list[Spec] | None:
    """Return the specs of an operator with one number, such as `x / 127.5`; None for any other.

    Args:
        name: Keras 2's function, such as `math.truediv`, or Keras 3's class, such as `TrueDivide`.
        constants: numbers that it was called with.
    """
    sign = FUNCTIONS.get(name.rpartition(".")[2].lower())
    if sign is None or len(constants) != 1 or (sign == "/" and not constants[0]):
        return None
    (number,) = constants
    if sign in "*/":
        return [{"layer": "Rescaling", "scale": number if sign == "*" else 1 / number}]
    return [{"layer": "Rescaling", "scale": 1.0, "offset": number if sign == "+" else -number}]


def activation_specs(value: object, version: int) -> list[Spec]:
    """Return the specs of an activation: a name, or a layer or function with its config."""
    if isinstance(value, dict):
        name, config = value.get("class_name"), value.get("config")
        if isinstance(config, str):  # Keras 3: a function's name
            value = config
        elif isinstance(name, str) and isinstance(config, dict):
            specs = specs_of(name, config, version)
            if specs is not None:
                return specs
            value = name
    if value is None or value == "linear":
        return []
    if value == "hard_sigmoid" and version >= 3:
        return [{"layer": "Activation", "activation": "hard_sigmoid_3"}]
    name = _ACTIVATIONS.get(value, value) if isinstance(value, str) else ""
    if name not in ACTIVATIONS:
        raise UnknownValueError(f"its activation is {value!s:.60}")
    return [{"layer": "Activation", "activation": name}]
