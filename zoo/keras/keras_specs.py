"""Translate a Keras layer's config to specs of `zoo.models.sequential`, for Keras 1, 2 and 3.

Values pass as they are: the network checks them when it is built. None stands for the default.
"""

from collections.abc import Callable
from typing import Any

from zoo.models.value_layers import ACTIVATIONS

Spec = dict[str, Any]


class UnknownValueError(ValueError):
    """An error about a config's value that has no counterpart."""


def _first(config: dict, *keys: str) -> Any:
    """Return the first value that a config has, of several names of a setting."""
    return next((config[key] for key in keys if config.get(key) is not None), None)


def _pair(config: dict, *keys: str) -> Any:
    """Return two numbers, where the config may have one for both; None if they are 1."""
    value = _first(config, *keys)
    pair = [value, value] if type(value) is int else value
    return None if pair in ([1, 1], (1, 1)) else pair


def _number(value: Any) -> Any:
    """Return a number, also from Keras 2's `{"type": ..., "value": ...}` for numpy's numbers."""
    return value.get("value", value) if isinstance(value, dict) else value


def _window(config: dict, stride: str = "strides") -> Spec:
    padding = _first(config, "padding", "border_mode")
    return {
        "strides": _pair(config, stride, "subsample"),
        "padding": None if padding == "valid" else padding,
    }


def _convolution(config: dict) -> Spec:
    size = _first(config, "kernel_size")
    if size is None and "nb_row" in config:
        size = [config.get("nb_row"), config.get("nb_col")]
    bias = _first(config, "use_bias", "bias")
    return _window(config) | {
        "filters": _first(config, "filters", "nb_filter"),
        "kernel_size": [size, size] if type(size) is int else size,
        "dilation_rate": _pair(config, "dilation_rate", "atrous_rate"),
        "use_bias": None if bias is True else bias,
    }


def _conv2d(config: dict) -> Spec:
    groups = config.get("groups")
    return _convolution(config) | {"groups": None if groups == 1 else groups}


def _depthwise(config: dict) -> Spec:
    return _convolution(config) | {"depth_multiplier": config.get("depth_multiplier")}


def _depthwise_alone(config: dict) -> Spec:
    return _depthwise(config) | {"filters": None}


def _one(value: Any) -> Any:
    """Return the number in a list of one."""
    return value[0] if isinstance(value, list | tuple) and len(value) == 1 else value


def _conv1d(config: dict) -> Spec:
    padding = _first(config, "padding", "border_mode")
    bias = _first(config, "use_bias", "bias")
    return {
        "filters": _first(config, "filters", "nb_filter"),
        "kernel_size": _one(_first(config, "kernel_size", "filter_length")),
        "strides": _one(_first(config, "strides", "subsample_length")),
        "dilation_rate": _one(config.get("dilation_rate")),
        "padding": None if padding == "valid" else padding,
        "use_bias": None if bias is True else bias,
    }


def _dense(config: dict) -> Spec:
    bias = _first(config, "use_bias", "bias")
    return {
        "units": _first(config, "units", "output_dim"),
        "use_bias": None if bias is True else bias,
    }


def _pool(config: dict) -> Spec:
    size = config.get("pool_size")
    stride = config.get("strides")
    padding = _first(config, "padding", "border_mode")
    return {
        "pool_size": [size, size] if type(size) is int else size,
        "strides": [stride, stride] if type(stride) is int else stride,
        "padding": None if padding == "valid" else padding,
    }


def _pool1d(config: dict) -> Spec:
    padding = _first(config, "padding", "border_mode")
    return {
        "pool_size": _one(_first(config, "pool_size", "pool_length")),
        "strides": _one(_first(config, "strides", "stride")),
        "padding": None if padding == "valid" else padding,
    }


def _batch_norm(config: dict) -> Spec:
    if config.get("mode") not in (None, 0):
        raise UnknownValueError(f"its mode is {config['mode']!s:.20}; only mode 0 can be converted")
    flags = {
        key: None if config.get(key) is True else config.get(key) for key in ("center", "scale")
    }
    return {
        "axis": _one(config.get("axis")),
        "epsilon": _number(config.get("epsilon")),
        "momentum": _number(config.get("momentum")),
        **flags,
    }


def _edges(value: Any) -> Any:
    """Return `[[top, bottom], [left, right]]`, from one number, two, or Keras 1's four."""
    if type(value) is int:
        return [[value, value], [value, value]]
    if isinstance(value, dict):
        names = ("top_pad", "bottom_pad"), ("left_pad", "right_pad")
        return [[value.get(name, 0) for name in pair] for pair in names]
    if isinstance(value, list | tuple) and all(type(one) is int for one in value):
        if len(value) == 2:
            return [[one, one] for one in value]
        if len(value) == 4:
            return [list(value[:2]), list(value[2:])]
    return value


def _rate(config: dict) -> Spec:
    return {"rate": _number(_first(config, "rate", "p"))}


def _relu(config: dict) -> Spec:
    slope = _number(_first(config, "negative_slope"))
    return {
        "max_value": _number(config.get("max_value")),
        "negative_slope": slope or None,
        "threshold": _number(config.get("threshold")) or None,
    }


def _prelu(config: dict) -> Spec:
    return {"shared_axes": config.get("shared_axes")}


def _resizing(config: dict) -> Spec:
    methods = {"bilinear": "linear", "nearest": "nearest", "area": "area"}
    method = config.get("interpolation", "bilinear")
    if (
        str(method) not in methods
        or config.get("crop_to_aspect_ratio")
        or config.get("pad_to_aspect_ratio")
    ):
        raise UnknownValueError(
            f"its interpolation is {method!s:.40}, or it keeps the aspect ratio"
        )
    return {
        "layer": "Resize",
        "size": [config.get("height"), config.get("width")],
        "method": methods[method],
    }


TRANSLATIONS: dict[str, Callable[[dict], Spec]] = {
    "Conv2D": _conv2d,
    "SeparableConv2D": _depthwise,
    "DepthwiseConv2D": _depthwise_alone,
    "Conv1D": _conv1d,
    "Dense": _dense,
    "Flatten": lambda config: {},
    "Reshape": lambda config: {"target_shape": config.get("target_shape")},
    "Permute": lambda config: {"dims": config.get("dims")},
    "MaxPooling2D": _pool,
    "AveragePooling2D": _pool,
    "MaxPooling1D": _pool1d,
    "AveragePooling1D": _pool1d,
    "GlobalAveragePooling2D": lambda config: {"keepdims": config.get("keepdims") or None},
    "GlobalMaxPooling2D": lambda config: {"keepdims": config.get("keepdims") or None},
    "BatchNormalization": _batch_norm,
    "Activation": lambda config: {},
    "Softmax": lambda config: {"layer": "Activation", "activation": "softmax"},
    "ELU": lambda config: {"alpha": _number(config.get("alpha"))},
    "LeakyReLU": lambda config: {"alpha": _number(_first(config, "negative_slope", "alpha"))},
    "PReLU": _prelu,
    "ReLU": _relu,
    "ThresholdedReLU": lambda config: {
        "layer": "ThresholdedReLU", "theta": _number(config.get("theta")),
    },
    "Cropping2D": lambda config: {"cropping": _edges(config.get("cropping"))},
    "ZeroPadding2D": lambda config: {"padding": _edges(config.get("padding"))},
    "Resizing": _resizing,
    "Rescaling": lambda config: {"scale": _number(config.get("scale")),
                                 "offset": _number(config.get("offset"))},
    "Dropout": _rate,
    "SpatialDropout2D": _rate,
    "GaussianNoise": lambda config: {"stddev": _number(_first(config, "stddev", "sigma"))},
    "GaussianDropout": _rate,
}  # fmt: skip


WITH_ACTIVATION = ("Conv2D", "SeparableConv2D", "DepthwiseConv2D", "Conv1D", "Dense")


# Names of Keras 1 and of aliases.
CLASSES = {
    "Convolution2D": "Conv2D",
    "AtrousConvolution2D": "Conv2D",
    "SeparableConvolution2D": "SeparableConv2D",
    "DepthwiseConvolution2D": "DepthwiseConv2D",
    "Convolution1D": "Conv1D",
    "MaxPool2D": "MaxPooling2D",
    "AvgPool2D": "AveragePooling2D",
    "MaxPool1D": "MaxPooling1D",
    "AvgPool1D": "AveragePooling1D",
    "GlobalAvgPool2D": "GlobalAveragePooling2D",
    "GlobalMaxPool2D": "GlobalMaxPooling2D",
    "BatchNormalizationV1": "BatchNormalization",
    "BatchNormalizationV2": "BatchNormalization",
}


# Orders of axes, of Keras 2 and 1.
ORDERS = {"channels_first": "channels_first", "th": "channels_first"}


ORDERS |= {"channels_last": "channels_last", "tf": "channels_last"}


# Layers that change nothing in driving, and need no place in the network.
IDENTITIES = (
    "InputLayer", "ActivityRegularization", "Masking", "Identity", "RandomContrast", "RandomFlip",
    "RandomBrightness", "RandomRotation", "RandomTranslation", "RandomZoom",
)  # fmt: skip


RECURRENT = ("LSTM", "GRU", "SimpleRNN", "RNN", "ConvLSTM2D", "Bidirectional", "TimeDistributed")


_ACTIVATIONS = {
    "silu": "swish",
    "hard_silu": "hard_swish",
    "hard_swish": "hard_swish",
    "relu6": "relu6",
}


# Operators of functional models, of Keras 2 (config's `function`) and Keras 3 (class).
OPERATORS = {
    "math.truediv": "/", "math.divide": "/", "TrueDivide": "/", "Divide": "/",
    "math.multiply": "*", "Multiply": "*",
    "math.subtract": "-", "Subtract": "-",
    "__operators__.add": "+", "math.add": "+", "Add": "+",
}  # fmt: skip


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
    kind = CLASSES.get(kind, kind)
    translate = TRANSLATIONS.get(kind)
    if translate is None:
        return None
    spec = {"layer": kind} | translate(config)
    if ORDERS.get(str(config.get("data_format", config.get("dim_ordering")))) == "channels_first":
        spec["data_format"] = "channels_first"
    more = []
    if kind in WITH_ACTIVATION:
        more = activation_specs(config.get("activation"), version)
        if len(more) == 1 and more[0]["layer"] == "Activation":
            spec["activation"], more = more[0]["activation"], []
    elif kind == "Activation":
        return activation_specs(config.get("activation"), version)
    return [{key: value for key, value in spec.items() if value is not None}, *more]


def operator_specs(name: str, constants: tuple[float, ...]) -> list[Spec] | None:
    """Return the specs of an operator with one number, such as `x / 127.5`; None for any other."""
    sign = OPERATORS.get(name)
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
