"""Plots of batches and predictions: PNG files in the run's `plots/`, and TensorBoard."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning import Callback, LightningModule, Trainer
from lightning.pytorch.loggers import TensorBoardLogger
from matplotlib.figure import Figure
from matplotlib.image import imread

from datamodules.balance import Count
from datamodules.batches import Batch
from datamodules.driving import DrivingData
from zoo.base.terminal import counted
from zoo.runs import plots
from zoo.training.run_module import data_of


class FedBatch(Callback):
    """`plots/fed_batch.png`: the first samples of the first batches, with their labels.

    Args:
        count: number of samples.
    """

    def __init__(self, count: Count = 32) -> None:
        self.count = count

    def on_train_start(self, trainer: Trainer, module: LightningModule) -> None:
        """Plot the samples."""
        data = data_of(trainer)
        if trainer.is_global_zero and isinstance(data, DrivingData):
            publish(trainer, "fed_batch", figure_of_fed_batch(data, self.count))


class SteeringHistogram(Callback):
    """`plots/steering_histogram.png`: steering before and after balancing and flipping."""

    def on_train_start(self, trainer: Trainer, module: LightningModule) -> None:
        """Plot the steering."""
        data = data_of(trainer)
        if trainer.is_global_zero and isinstance(data, DrivingData):
            publish(trainer, "steering_histogram", figure_of_steering(data))


class PredictedAgainstTrue(Callback):
    """`plots/predicted_against_true_val.png` during training.

    Args:
        every_n_epochs: number of epochs between two plots.
    """

    def __init__(self, every_n_epochs: Count = 5) -> None:
        self.every_n_epochs = every_n_epochs

    def on_validation_end(self, trainer: Trainer, module: Any) -> None:
        """Plot the validation rows."""
        epoch = trainer.current_epoch + 1
        if epoch % self.every_n_epochs or not trainer.is_global_zero or module.validation is None:
            return
        predicted, true = module.validation
        figure = plots.predicted_against_true(predicted, true, f"validation, epoch {epoch}")
        publish(trainer, "predicted_against_true_val", figure)


def figure_of_fed_batch(data: DrivingData, count: int) -> Figure:
    """Plot the first `count` network inputs of an epoch, whatever the batch size.

    Windows are rows of frames, of `count` frames or a few more.
    """
    sequence = data.windows.sequence
    count = -(-count // sequence)
    batches, fed = data.training_batches(), list[Batch]()
    for key in data.sampler():  # whole batches: a part of one would be augmented otherwise
        fed.append(batches[key])
        if sum(len(batch["targets"]) for batch in fed) >= count:
            break
    images = torch.cat([batch["images"] for batch in fed])[:count].movedim(-3, -1).numpy()
    height, width, channels = images.shape[-3:]
    kind = f"{width} x {height} {data.view.colour}, {counted(channels, 'channel')}"
    title = f"network inputs: {kind}; steering above each image"
    steering = torch.cat([batch["targets"][..., 0] for batch in fed])[:count].numpy()
    if sequence > 1:
        title += "; a window in each row, oldest frame first"
        steering = steering[:, :sequence]
    elif data.windows.is_windowed:
        images, steering = images[:, 0], steering[:, 0]
    return plots.fed_batch(images, steering, data.view.colour, title)


def figure_of_steering(data: DrivingData) -> Figure:
    """Plot the steering of all samples, and of up to 50,000 as drawn and flipped."""
    batches = data.training_batches()
    fed = []
    for key in data.sampler():
        fed.append(batches.steering(key))
        if sum(map(len, fed)) > 50_000:
            break
    threshold = data.options.straight_threshold
    return plots.steering_histogram(data.samples.steering, np.concatenate(fed), threshold)


def publish(trainer: Trainer, name: str, figure: Figure) -> None:
    """Save a plot as PNG; log it to TensorBoard if that is on."""
    path = plots.save_figure(figure, Path(trainer.default_root_dir) / "plots" / f"{name}.png")
    for logger in trainer.loggers:
        if isinstance(logger, TensorBoardLogger):
            step = trainer.current_epoch
            logger.experiment.add_image(name, imread(path), step, dataformats="HWC")
