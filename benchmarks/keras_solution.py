"""For `benchmarks/keras_training.py`, in an interpreter that has TensorFlow: the course, in Keras.

NVIDIA's network and a Python generator of batches, as N. Shibuya's solution has them (GitHub,
naokishibuya/car-behavioral-cloning), written anew from what it does: batches of 40; six samples of
ten take a camera at random and are flipped, shifted and lit, the others the centre one as it is;
each picture is read when it is drawn, cropped, resized by area and turned to YUV. Ours reads with
OpenCV, which is quicker than the original's matplotlib.

`python keras_solution.py LOG STEPS`: for each line that it is sent it takes so many steps and
answers with its samples a second.
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
    """NVIDIA's, with ELU and one dropout."""
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
    """Batch after batch of pictures, float64 [40, 66, 200, 3], and their steering."""
    with log.open() as file:
        rows = [(line[:3], float(line[3])) for line in csv.reader(file)]
    rng = np.random.default_rng(0)
    while True:
        pictures, steering = np.empty((BATCH, *SHAPE)), np.empty(BATCH)
        for at, row in enumerate(rng.permutation(len(rows))[:BATCH]):
            (center, left, right), angle = rows[row]
            if rng.random() < 0.6:
                camera = rng.integers(3)
                picture = read(log.parent / (center, left, right)[camera])
                picture, angle = change(picture, angle + (0, OFFSET, -OFFSET)[camera], rng)
            else:
                picture = read(log.parent / center)
            pictures[at], steering[at] = view(picture), angle
        yield pictures, steering


def read(path: Path) -> np.ndarray:
    """uint8 [160, 320, 3], RGB."""
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


def change(picture: np.ndarray, angle: float, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Flipped, shifted and lit by chance."""
    if rng.random() < 0.5:
        picture, angle = cv2.flip(picture, 1), -angle
    right, down = rng.uniform(-50, 50), rng.uniform(-5, 5)
    matrix = np.float32([[1, 0, right], [0, 1, down]])
    picture = cv2.warpAffine(picture, matrix, picture.shape[1::-1])
    hsv = cv2.cvtColor(picture, cv2.COLOR_RGB2HSV)
    hsv[:, :, 2] = np.minimum(hsv[:, :, 2] * rng.uniform(0.8, 1.2), 255)
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB), angle + 0.002 * right


def view(picture: np.ndarray) -> np.ndarray:
    """What the network sees."""
    small = cv2.resize(picture[60:-25], SHAPE[1::-1], interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(small, cv2.COLOR_RGB2YUV)


class Clock(keras.callbacks.Callback):
    """Times the steps alone, not what `fit` does before the first."""

    def on_train_batch_begin(self, batch: int, logs: dict | None = None) -> None:
        if batch == 0:
            self.began = time.perf_counter()

    def on_train_batch_end(self, batch: int, logs: dict | None = None) -> None:
        self.seconds = time.perf_counter() - self.began


def main(log: Path, steps: int) -> None:
    """Once to warm up, then once for each line."""
    model, feed, clock = network(), batches(log), Clock()
    model.fit(feed, steps_per_epoch=max(2, steps // 4), verbose=0)
    print(f"ready: Keras {keras.__version__} on {keras.backend.backend()}", flush=True)
    for _ in sys.stdin:
        model.fit(feed, steps_per_epoch=steps, verbose=0, callbacks=[clock])
        print(BATCH * steps / clock.seconds, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
