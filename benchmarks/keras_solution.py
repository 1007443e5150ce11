"""A Keras solution of the course for `benchmarks/keras_training.py`, run by a Python with Keras.

It is NVIDIA's network and a Python generator of batches of 40, rewritten after N. Shibuya's
solution (GitHub, naokishibuya/car-behavioral-cloning). Six of ten samples have a random camera and
are flipped, shifted and changed in brightness. The others have the centre camera, unchanged. Each
image is read when its sample is drawn, then cropped, resized by area and converted to YUV. This
version reads with OpenCV, which is faster than the original's matplotlib.

`python keras_solution.py LOG STEPS` trains STEPS steps for each line on its standard input and
prints the samples per second.
"""

import csv
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import keras
import numpy as np
from keras import layers

BATCH, LEARNING_RATE, OFFSET = 40, 1e-4, 0.2
SHAPE = (66, 200, 3)


def network() -> keras.Model:
    """Return NVIDIA's network with ELU and one dropout."""
    convolutions = [(24, 5, 2), (36, 5, 2), (48, 5, 2), (64, 3, 1), (64, 3, 1)]
    model = keras.Sequential([keras.Input(SHAPE), layers.Rescaling(1 / 127.5, -1)])
    for channels, kernel, stride in convolutions:
        model.add(layers.Conv2D(channels, kernel, stride, activation="elu"))
    model.add(layers.Dropout(0.5))
    model.add(layers.Flatten())
    for units in (100, 50, 10):
        model.add(layers.Dense(units, activation="elu"))
    model.add(layers.Dense(1))
    model.compile(loss="mean_squared_error", optimizer=keras.optimizers.Adam(LEARNING_RATE))
    return model


def batches(log: Path) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield batches of images, float64 [40, 66, 200, 3], and their steering."""
    with log.open() as file:
        rows = [(line[:3], float(line[3])) for line in csv.reader(file)]
    rng = np.random.default_rng(0)
    while True:
        images, steering = np.empty((BATCH, *SHAPE)), np.empty(BATCH)
        for at, row in enumerate(rng.permutation(len(rows))[:BATCH]):
            (center, left, right), angle = rows[row]
            if rng.random() < 0.6:
                camera = rng.integers(3)
                image = read(log.parent / (center, left, right)[camera])
                image, angle = change(image, angle + (0, OFFSET, -OFFSET)[camera], rng)
            else:
                image = read(log.parent / center)
            images[at], steering[at] = view(image), angle
        yield images, steering


def read(path: Path) -> np.ndarray:
    """Read an image: uint8 [160, 320, 3], RGB."""
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


def change(image: np.ndarray, angle: float, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Flip, shift and change brightness at random."""
    if rng.random() < 0.5:
        image, angle = cv2.flip(image, 1), -angle
    right, down = rng.uniform(-50, 50), rng.uniform(-5, 5)
    matrix = np.float32([[1, 0, right], [0, 1, down]])
    image = cv2.warpAffine(image, matrix, image.shape[1::-1])
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    hsv[:, :, 2] = np.minimum(hsv[:, :, 2] * rng.uniform(0.8, 1.2), 255)
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB), angle + 0.002 * right


def view(image: np.ndarray) -> np.ndarray:
    """Return the network's view of an image."""
    small = cv2.resize(image[60:-25], SHAPE[1::-1], interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(small, cv2.COLOR_RGB2YUV)


class Clock(keras.callbacks.Callback):
    """A timer of the steps, without the work of `fit` before the first."""

    def on_train_batch_begin(self, batch: int, logs: dict | None = None) -> None:
        if batch == 0:
            self.began = time.perf_counter()

    def on_train_batch_end(self, batch: int, logs: dict | None = None) -> None:
        self.seconds = time.perf_counter() - self.began


def main(log: Path, steps: int) -> None:
    """Train once to warm up, then once for each line of standard input."""
    model, feed, clock = network(), batches(log), Clock()
    model.fit(feed, steps_per_epoch=max(2, steps // 4), verbose=0)
    print(f"ready: Keras {keras.__version__} on {keras.backend.backend()}", flush=True)
    for _ in sys.stdin:
        model.fit(feed, steps_per_epoch=steps, verbose=0, callbacks=[clock])
        print(BATCH * steps / clock.seconds, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
