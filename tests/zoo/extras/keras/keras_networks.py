"""Keras 2 files of small networks that steer."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from datamodules.image import read_image
from datamodules.recording import Recording
from datamodules.view import View
from tests.zoo.extras.keras.keras_files import Layer, lambda_config, write_h5
from zoo.extras.keras.tied_drives import STRETCH

RIDGE = 10.0
SHORT_STRETCH = replace(STRETCH, laps=0.01, quality="simple")  # 285 m take a minute
SCALED: Layer = ("Lambda", lambda_config(lambda x: x / 127.5 - 1.0), [])


def dense_layer(kernel: np.ndarray, bias: np.ndarray, activation: str = "linear") -> Layer:
    """Return a Dense with a kernel [in, out]."""
    return "Dense", {"units": kernel.shape[1], "activation": activation}, [kernel, bias]


def fit_steering(recording: Recording, view: View, scale: tuple[float, float]) -> Layer:
    """Return a Dense of a linear regression from views, scaled, to the steering.

    The side cameras' images are samples, too, so that the network steers back to the centre.
    """
    offsets = (0.0, 0.25, -0.25)
    images = [view(read_image(path)) for row in recording.images for path in row]
    inputs = np.stack(images).reshape(len(images), -1) / scale[0] - scale[1]
    steering = (recording.steering[:, None] + offsets).ravel()
    middle = inputs.mean(0)
    centred = inputs - middle
    # Ridge regression in its dual form: there are fewer images than pixels.
    ridge = centred @ centred.T + RIDGE * np.eye(len(images))
    weights = centred.T @ np.linalg.solve(ridge, steering)
    bias = -middle @ weights
    return dense_layer(weights.astype(np.float32)[:, None], np.array([bias], np.float32))


def write_steering_h5(path: Path, recording: Recording, view: View, *before: Layer) -> Path:
    """Write a linear network that steers by a view of -1..1, after other layers."""
    layers = [*before, ("Flatten", {}, []), fit_steering(recording, view, (127.5, 1.0))]
    return write_h5(path, layers, shape=view.shape)
