"""Translate the settings of each class of layer, of Keras 1, 2 and 3, to those of a spec.

Values pass as they are: the network checks them when it is built. None stands for the default.
"""

from collections.abc import Callable
from typing import Any

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
        method not in methods
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
