"""Keras' layers in NumPy, channels last and in float64, written without our code.

Each function takes values [N, ...], a layer's config as Keras 2 names it, and its weights.
"""

from collections.abc import Callable

import numpy as np

ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "linear": lambda x: x,
    "relu": lambda x: np.maximum(x, 0),
    "relu6": lambda x: np.clip(x, 0, 6),
    "elu": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0))),
    "selu": lambda x: (
        1.0507009873554805 * np.where(x > 0, x, 1.6732632423543772 * np.expm1(np.minimum(x, 0)))
    ),
    "tanh": np.tanh,
    "sigmoid": lambda x: 1 / (1 + np.exp(-x)),
    "hard_sigmoid": lambda x: np.clip(0.2 * x + 0.5, 0, 1),
    "hard_sigmoid_3": lambda x: np.clip(x / 6 + 0.5, 0, 1),
    "softplus": lambda x: np.log1p(np.exp(x)),
    "softsign": lambda x: x / (1 + np.abs(x)),
    "exponential": np.exp,
    "swish": lambda x: x / (1 + np.exp(-x)),
    "hard_swish": lambda x: x * np.clip(x / 6 + 0.5, 0, 1),
    "mish": lambda x: x * np.tanh(np.log1p(np.exp(x))),
    "leaky_relu": lambda x: np.where(x > 0, x, 0.2 * x),
    "atan": np.arctan,
    "softmax": lambda x: np.exp(x) / np.exp(x).sum(-1, keepdims=True),
}


def windows(
    x: np.ndarray, size: tuple, stride: tuple, padding: str, fill: float, gap: tuple = (1, 1)
) -> np.ndarray:
    """Return windows [N, rows, columns, C, h, w]; `same` pads as TensorFlow does."""
    pads = [(0, 0)]
    reach = [(side - 1) * step + 1 for side, step in zip(size, gap, strict=True)]
    for length, side, step in zip(x.shape[1:3], reach, stride, strict=True):
        total = max((-(-length // step) - 1) * step + side - length, 0) if padding == "same" else 0
        pads.append((total // 2, total - total // 2))
    x = np.pad(x, [*pads, (0, 0)], constant_values=fill)
    view = np.lib.stride_tricks.sliding_window_view(x, reach, axis=(1, 2))
    return view[:, :: stride[0], :: stride[1], :, :: gap[0], :: gap[1]]


def kernel_windows(x: np.ndarray, config: dict, kernel: np.ndarray) -> np.ndarray:
    stride, padding = config.get("strides", (1, 1)), config.get("padding", "valid")
    return windows(x, kernel.shape[:2], stride, padding, 0, config.get("dilation_rate", (1, 1)))


def pool_windows(x: np.ndarray, config: dict, fill: float) -> np.ndarray:
    size = config.get("pool_size", (2, 2))
    return windows(x, size, config.get("strides") or size, config.get("padding", "valid"), fill)


def conv2d(x: np.ndarray, config: dict, weights: list) -> np.ndarray:
    kernel = weights[0]
    groups = config.get("groups", 1)
    patches = kernel_windows(x, config, kernel)
    parts = zip(np.split(patches, groups, 3), np.split(kernel, groups, 3), strict=True)
    out = np.concatenate([np.einsum("nrcihw,hwio->nrco", a, b) for a, b in parts], -1)
    return out + weights[1] if len(weights) > 1 else out


def depthwise(x: np.ndarray, config: dict, weights: list) -> np.ndarray:
    kernel = weights[0]
    patches = kernel_windows(x, config, kernel)
    out = np.einsum("nrcihw,hwim->nrcim", patches, kernel)
    out = out.reshape(*out.shape[:3], -1)
    return out + weights[1] if len(weights) > 1 else out


def separable(x: np.ndarray, config: dict, weights: list) -> np.ndarray:
    out = depthwise(x, config, weights[:1]) @ weights[1][0, 0]
    return out + weights[2] if len(weights) > 2 else out


def batch_norm(x: np.ndarray, config: dict, weights: list) -> np.ndarray:
    weights = list(weights)
    axis = config.get("axis", -1)
    shape = [1] * x.ndim
    shape[axis] = x.shape[axis]
    gamma = weights.pop(0).reshape(shape) if config.get("scale", True) else 1
    beta = weights.pop(0).reshape(shape) if config.get("center", True) else 0
    mean, variance = (array.reshape(shape) for array in weights)
    return (x - mean) / np.sqrt(variance + config.get("epsilon", 1e-3)) * gamma + beta


def relu(x: np.ndarray, config: dict, _: list) -> np.ndarray:
    threshold = config.get("threshold", 0)
    below = config.get("negative_slope", 0) * (x - threshold)
    out = np.where(x >= threshold, x, below)
    most = config.get("max_value")
    return out if most is None else np.where(x >= most, most, out)


def cropped(x: np.ndarray, config: dict, _: list) -> np.ndarray:
    (top, bottom), (left, right) = config["cropping"]
    return x[:, top : x.shape[1] - bottom, left : x.shape[2] - right]


LAYERS: dict[str, Callable[[np.ndarray, dict, list], np.ndarray]] = {
    "Conv2D": conv2d,
    "DepthwiseConv2D": depthwise,
    "SeparableConv2D": separable,
    "Dense": lambda x, c, w: x @ w[0] + (w[1] if len(w) > 1 else 0),
    "Flatten": lambda x, c, w: x.reshape(len(x), -1),
    "Reshape": lambda x, c, w: x.reshape(len(x), *c["target_shape"]),
    "Permute": lambda x, c, w: x.transpose(0, *c["dims"]),
    "MaxPooling2D": lambda x, c, w: pool_windows(x, c, -np.inf).max((-1, -2)),
    "AveragePooling2D": lambda x, c, w: np.nanmean(pool_windows(x, c, np.nan), (-1, -2)),
    "GlobalAveragePooling2D": lambda x, c, w: x.mean((1, 2)),
    "GlobalMaxPooling2D": lambda x, c, w: x.max((1, 2)),
    "BatchNormalization": batch_norm,
    "Activation": lambda x, c, w: x,
    "ELU": lambda x, c, w: np.where(x > 0, x, c.get("alpha", 1) * np.expm1(np.minimum(x, 0))),
    "LeakyReLU": lambda x, c, w: np.where(x > 0, x, c.get("alpha", 0.3) * x),
    "PReLU": lambda x, c, w: np.where(x > 0, x, w[0] * x),
    "ReLU": relu,
    "Cropping2D": cropped,
    "ZeroPadding2D": lambda x, c, w: np.pad(x, [(0, 0), *c["padding"], (0, 0)]),
    "Rescaling": lambda x, c, w: x * np.array(c["scale"]) + np.array(c.get("offset", 0)),
    "Dropout": lambda x, c, w: x,
    "SpatialDropout2D": lambda x, c, w: x,
    "GaussianNoise": lambda x, c, w: x,
}


def predict(x: np.ndarray, layers: list[tuple[str, dict, list]]) -> np.ndarray:
    """Return the outputs of layers, each a class, a config and weights."""
    x = x.astype(np.float64)
    for kind, config, weights in layers:
        x = LAYERS[kind](x, config, [array.astype(np.float64) for array in weights])
        x = ACTIVATIONS[config.get("activation", "linear")](x)
    return x
