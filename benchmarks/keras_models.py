"""Keras models over all layers, for `benchmarks/keras_parity.py`, run by a Python with Keras.

`python keras_models.py FOLDER [MODEL ...]` reads frames of several sizes from FOLDER/frames.npz. It
writes each model with random weights as `.h5`, as `.json` with weights, and as `.keras`, and the
models' outputs in FOLDER/expected.npz. Keras 3 and, if `tf-keras` is installed, Keras 2 are used.
"""

import json
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROWS, COLUMNS = 34, 46
ACTIVATIONS = (
    "relu", "elu", "tanh", "sigmoid", "linear", "softplus", "softsign", "selu", "hard_sigmoid",
    "swish", "exponential", "relu6", "gelu",
)  # fmt: skip


def conv(k: object, *arguments: object, **more: object) -> object:
    """Return a convolution with few channels."""
    return k.layers.Conv2D(*arguments, **more)


def head(k: object) -> list:
    """Return the layers from images to the steering."""
    return [k.layers.Flatten(), k.layers.Dense(5, activation="tanh"), k.layers.Dense(1)]


def variants(k: object) -> dict[str, Callable[[], list]]:
    """Return functions from a name to the layers of a small model, after the input."""
    lay = k.layers
    scale = lambda: lay.Lambda(lambda x: x / 127.5 - 1.0, output_shape=lambda s: s)  # noqa: E731
    found: dict[str, Callable[[], list]] = {
        "plain": lambda: [scale(), conv(k, 4, 5, strides=2, activation="elu"), *head(k)],
        "crop": lambda: [
            lay.Cropping2D(((7, 5), (2, 1))), scale(), conv(k, 4, 3, activation="relu"), *head(k),
        ],
        "separable": lambda: [
            scale(),
            lay.SeparableConv2D(5, 3, strides=2, padding="same", depth_multiplier=2),
            lay.SeparableConv2D(4, (3, 5), use_bias=False, activation="relu", dilation_rate=2),
            *head(k),
        ],
        "depthwise": lambda: [
            scale(),
            lay.DepthwiseConv2D(3, depth_multiplier=2, activation="relu"),
            lay.DepthwiseConv2D((2, 4), strides=2, padding="same", use_bias=False),
            *head(k),
        ],
        "groups": lambda: [
            scale(), conv(k, 6, 3, groups=3), conv(k, 6, 3, groups=6, strides=2), *head(k),
        ],
        "dilated": lambda: [
            scale(), conv(k, 4, 3, dilation_rate=3), conv(k, 4, 4, dilation_rate=2, padding="same"),
            *head(k),
        ],
        "gray_input": lambda: [scale(), conv(k, 4, 3), *head(k)],
        "batchnorm_first": lambda: [lay.BatchNormalization(), conv(k, 4, 3), *head(k)],
        "batchnorm_axis": lambda: [
            scale(), lay.BatchNormalization(axis=1, epsilon=1e-2), lay.BatchNormalization(axis=2),
            conv(k, 3, 3), *head(k),
        ],
        "batchnorm_flags": lambda: [
            scale(), conv(k, 4, 3, use_bias=False), lay.BatchNormalization(center=False),
            lay.BatchNormalization(scale=False), lay.Activation("relu"),
            lay.Flatten(), lay.BatchNormalization(), lay.Dense(3), lay.BatchNormalization(),
            lay.Dense(1),
        ],
        "elu_leaky": lambda: [
            scale(), conv(k, 3, 3), lay.ELU(0.7), conv(k, 3, 3), lay.LeakyReLU(), *head(k),
        ],
        "leaky_slope": lambda: [scale(), conv(k, 3, 3), lay.LeakyReLU(0.13), *head(k)],
        "prelu": lambda: [
            scale(), conv(k, 3, 3), lay.PReLU(), conv(k, 3, 3), lay.PReLU(shared_axes=[1, 2]),
            conv(k, 3, 3), lay.PReLU(shared_axes=[2]), lay.Flatten(), lay.Dense(3), lay.PReLU(),
            lay.Dense(1),
        ],
        "relu_layer": lambda: [
            scale(), conv(k, 3, 3), lay.ReLU(), conv(k, 3, 3),
            lay.ReLU(max_value=0.4, negative_slope=0.1, threshold=0.05), *head(k),
        ],
        "global_mean": lambda: [
            scale(), conv(k, 8, 3, activation="relu"), lay.GlobalAveragePooling2D(), lay.Dense(1),
        ],
        "global_max": lambda: [
            scale(), conv(k, 8, 3, activation="relu"), lay.GlobalMaxPooling2D(), lay.Dense(1),
        ],
        "global_keeps": lambda: [
            scale(), conv(k, 8, 3), lay.GlobalAveragePooling2D(keepdims=True), conv(k, 1, 1),
            lay.Flatten(),
        ],
        "zero_padding": lambda: [
            scale(), lay.ZeroPadding2D(2), conv(k, 3, 3), lay.ZeroPadding2D(((1, 0), (3, 2))),
            conv(k, 3, 3), *head(k),
        ],
        "padding_before_scale": lambda: [
            lay.ZeroPadding2D((1, 2)), scale(), conv(k, 3, 3), *head(k),
        ],
        "dropouts": lambda: [
            scale(), conv(k, 4, 3), lay.SpatialDropout2D(0.2), lay.Dropout(0.3),
            lay.GaussianNoise(0.1), lay.GaussianDropout(0.2), *head(k),
        ],
        "reshape": lambda: [
            scale(), conv(k, 4, 3, strides=3), lay.Reshape((-1, 4)), lay.Conv1D(3, 4, strides=2),
            lay.MaxPooling1D(2), lay.Conv1D(3, 3, padding="same", activation="elu"),
            lay.AveragePooling1D(3, padding="same"), lay.Permute((2, 1)), *head(k),
        ],
        "reshape_images": lambda: [
            scale(), conv(k, 4, 3, strides=3), lay.Permute((2, 3, 1)), conv(k, 3, 2),
            lay.Flatten(), lay.Dense(24), lay.Reshape((2, 4, 3)), conv(k, 2, 2), *head(k),
        ],
        "dense_on_pixels": lambda: [
            scale(), conv(k, 4, 3, strides=3), lay.Dense(3, activation="softmax"), *head(k),
        ],
        "no_flatten": lambda: [
            scale(), conv(k, 4, 5, strides=4), conv(k, 1, (8, 11), activation="tanh"),
        ],
        "nested": lambda: [
            scale(),
            k.Sequential(
                [conv(k, 4, 3), lay.BatchNormalization(), lay.Activation("relu"), conv(k, 3, 3),
                 k.Sequential([conv(k, 2, 3), lay.BatchNormalization()])]
            ),
            k.Sequential([lay.Flatten(), lay.Dense(4), lay.Dense(1)]),
        ],
        "scale_255": lambda: [lay.Lambda(lambda x: x / 255.0 - 0.5), conv(k, 3, 3), *head(k)],
        "scale_only_255": lambda: [lay.Lambda(lambda x: x / 255.0), conv(k, 3, 3), *head(k)],
        "scale_128": lambda: [lay.Lambda(lambda x: (x - 128) / 128), conv(k, 3, 3), *head(k)],
        "rescaling": lambda: [lay.Rescaling(1 / 127.5, offset=-1), conv(k, 3, 3), *head(k)],
        "normalization": lambda: [
            lay.Normalization(mean=[100.0, 120.0, 90.0], variance=[900.0, 800.0, 1000.0]),
            conv(k, 3, 3), *head(k),
        ],
        "normalization_weights": lambda: [lay.Normalization(), conv(k, 3, 3), *head(k)],
        "resizing": lambda: [lay.Resizing(20, 30), scale(), conv(k, 3, 3), *head(k)],
        "two_outputs": lambda: [scale(), conv(k, 3, 3, strides=3), lay.Flatten(), lay.Dense(2)],
        "softmax_layer": lambda: [
            scale(), conv(k, 3, 3, strides=3), lay.Flatten(), lay.Dense(4), lay.Softmax(),
            lay.Dense(1),
        ],
    }  # fmt: skip
    for size in (1, 2, 3, 4, 5):
        for stride in (1, 2, 3):
            found[f"same_{size}_{stride}"] = lambda size=size, stride=stride: [
                scale(), conv(k, 3, size, strides=stride, padding="same"),
                lay.MaxPooling2D(size, strides=stride, padding="same"),
                lay.AveragePooling2D(size, strides=stride, padding="same"), *head(k),
            ]  # fmt: skip
    for size in (2, 3):
        found[f"pools_{size}"] = lambda size=size: [
            scale(), conv(k, 3, 3), lay.MaxPooling2D(size), conv(k, 3, 3),
            lay.AveragePooling2D((size, 2), strides=2), *head(k),
        ]  # fmt: skip
    for name in ACTIVATIONS:
        found[f"activation_{name}"] = lambda name=name: [
            scale(), conv(k, 3, 3, activation=name), conv(k, 3, 3, strides=2), lay.Activation(name),
            lay.BatchNormalization(), lay.Flatten(), lay.Dense(4, activation=name), lay.Dense(1),
        ]  # fmt: skip
    return found


def functional(k: object) -> object:
    """Return a functional model whose scale is an operator and not a layer."""
    inputs = k.layers.Input((ROWS, COLUMNS, 3))
    values = k.layers.Conv2D(4, 5, strides=2, activation="elu")(inputs / 127.5 - 1.0)
    values = k.layers.BatchNormalization()(values)
    values = k.layers.Flatten()(values)
    return k.Model(inputs, k.layers.Dense(1)(k.layers.Dropout(0.5)(values)))


def functional_nested(k: object) -> object:
    """Return a functional model with a functional model in it."""
    inputs = k.layers.Input((ROWS, COLUMNS, 3))
    inner_input = k.layers.Input((ROWS, COLUMNS, 3))
    values = k.layers.Conv2D(4, 5, strides=2)(inner_input)
    inner = k.Model(inner_input, k.layers.BatchNormalization()(values))
    values = k.layers.Lambda(lambda x: x / 127.5 - 1.0)(inputs)
    values = k.layers.Flatten()(inner(values))
    return k.Model(inputs, k.layers.Dense(1)(values))


def course(k: object) -> dict[str, Callable[[], object]]:
    """Return well-known networks of the course, at their own sizes."""
    lay = k.layers

    def nvidia() -> object:
        convolutions = [(24, 5, 2), (36, 5, 2), (48, 5, 2), (64, 3, 1), (64, 3, 1)]
        return k.Sequential(
            [lay.InputLayer((66, 200, 3)), lay.Lambda(lambda x: x / 127.5 - 1.0)]
            + [lay.Conv2D(f, s, strides=d, activation="elu") for f, s, d in convolutions]
            + [lay.Dropout(0.5), lay.Flatten()]
            + [lay.Dense(units, activation="elu") for units in (100, 50, 10)]
            + [lay.Dense(1)]
        )

    def comma() -> object:
        return k.Sequential([
            lay.InputLayer((160, 320, 3)), lay.Lambda(lambda x: x / 127.5 - 1.0),
            lay.Conv2D(16, 8, strides=4, padding="same"), lay.ELU(),
            lay.Conv2D(32, 5, strides=2, padding="same"), lay.ELU(),
            lay.Conv2D(64, 5, strides=2, padding="same"), lay.Flatten(), lay.Dropout(0.2),
            lay.ELU(), lay.Dense(512), lay.Dropout(0.5), lay.ELU(), lay.Dense(1),
        ])  # fmt: skip

    return {
        "nvidia": nvidia,
        "comma": comma,
        "functional": lambda: functional(k),
        "functional_nested": lambda: functional_nested(k),
    }


def randomize(model: object, rng: np.random.Generator) -> None:
    """Set every weight to a random value; variances are above 0."""
    for layer in model.weights:
        name = getattr(layer, "path", layer.name)
        if "int" in str(layer.dtype) or "seed" in name:
            continue
        shape = tuple(layer.shape)
        if "kernel" in name:
            values = rng.normal(size=shape) / np.sqrt(max(1, np.prod(shape[:-1])))
        elif "variance" in name or "gamma" in name:
            values = rng.uniform(0.5, 2, size=shape)
        else:
            values = rng.normal(size=shape) * 0.2
        layer.assign(values.astype("float32"))
    for layer in model.layers:
        if hasattr(layer, "finalize_state"):  # Normalization computes with copies of its weights
            layer.finalize_state()


def write_models(
    k: object, label: str, folder: Path, frames: dict, expected: dict, only: list[str]
) -> None:
    """Write the models of a version of Keras, all or `only` some, and keep their outputs."""
    rng = np.random.default_rng(0)
    makers: dict[str, Callable[[], object]] = dict(course(k))
    for name, layers in variants(k).items():
        shape = (ROWS, COLUMNS, 1 if name == "gray_input" else 3)
        makers[name] = lambda layers=layers, shape=shape: k.Sequential(
            [k.layers.InputLayer(shape), *layers()]
        )
    if hasattr(k.layers, "ThresholdedReLU"):
        makers["thresholded"] = lambda: k.Sequential(
            [k.layers.InputLayer((ROWS, COLUMNS, 3)), k.layers.Rescaling(1 / 255),
             k.layers.Conv2D(3, 3), k.layers.ThresholdedReLU(0.2), *head(k)]
        )  # fmt: skip
    for name, make in makers.items():
        if only and name not in only:
            continue
        key = f"{label}_{name}"
        try:
            k.backend.clear_session()
            model = make()
            randomize(model, rng)
            shape = tuple(model.input_shape[1:])
            given = frames[f"{shape[0]}x{shape[1]}"][..., : shape[2]]
            expected[key] = model.predict(given.astype("float32"), verbose=0)
            model.save(folder / f"{key}.h5")
            model.save(folder / f"{key}.keras")
            (folder / f"{key}_json.json").write_text(model.to_json())
            last = ".weights.h5" if label == "keras3" else ".h5"
            model.save_weights(folder / f"{key}_json{last}")
        except Exception:  # a layer or setting that this version does not have
            expected.pop(key, None)
            print(f"{key}: not built: {traceback.format_exc().splitlines()[-1]:.150}", flush=True)


def main(folder: Path, only: list[str]) -> None:
    frames = dict(np.load(folder / "frames.npz"))
    expected: dict[str, np.ndarray] = {}
    versions = {}
    for label, package in (("keras2", "tf_keras"), ("keras3", "keras")):
        try:
            k = __import__(package)
        except ImportError:
            continue
        versions[label] = k.__version__
        write_models(k, label, folder, frames, expected, only)
    np.savez(folder / "expected.npz", **expected)
    (folder / "versions.json").write_text(json.dumps(versions))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
