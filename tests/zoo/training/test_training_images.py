"""The plots of what is fed to a network."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from PIL import Image
from rich.console import Console
from tensorboard.backend.event_processing.event_file_loader import EventFileLoader

from datamodules.augment import Shift
from datamodules.data_settings import DataSettings
from tests.recordings import Written
from zoo.runs.plots import predicted_against_true, steering_histogram
from zoo.training.training_images import figure_of_fed_batch, publish


@pytest.mark.parametrize(
    ("windows", "columns", "rows"),
    [
        ({"sequence": 3, "ahead": 1}, 3, 4),
        ({"ahead": 1}, 3, 4),
        ({}, 3, 4),
        ({"sequence": 4}, 4, 3),
    ],
)
def test_a_window_is_a_row_of_frames(
    recorded: Written, console: Console, windows: dict, columns: int, rows: int
) -> None:
    settings = {"val_share": 0.0, "test_share": 0.0, "cache": None} | windows
    settings |= {"crop": (60, 25), "colour": "yuv", "size": (33, 100)}
    settings["augment"] = {"shift": Shift()}
    data = DataSettings(str(recorded.folder), **settings).load(console)
    (axis,) = figure_of_fed_batch(data, 11).axes
    places = np.array([text.get_position() for text in axis.texts])
    if windows.get("sequence"):
        assert len(places) == columns * rows
        assert len(np.unique(places[:, 0])) == columns
        assert len(np.unique(places[:, 1])) == rows
        assert (np.diff(places.reshape(rows, columns, 2)[:, :, 1]) == 0).all()
    else:
        batch = data.training_batches()[next(iter(data.sampler()))]
        fed = [f"{label + 0.0:+.3f}" for label in batch["targets"].reshape(64, -1)[:11, 0].tolist()]
        assert [text.get_text() for text in axis.texts] == fed
    assert len(axis.lines) == len(places)


def test_tensorboard_gets_the_saved_plot(tmp_path: Path) -> None:
    logger = TensorBoardLogger(tmp_path, name="", version="")
    trainer = SimpleNamespace(
        default_root_dir=tmp_path, current_epoch=4, loggers=[CSVLogger(tmp_path), logger]
    )
    publish(trainer, "steering", steering_histogram(np.zeros(9), np.ones(5), 0.1))
    logger.finalize("success")
    plot = tmp_path / "plots" / "steering.png"
    (events,) = tmp_path.glob("events.*")
    shown = [event for event in EventFileLoader(str(events)).Load() if event.HasField("summary")]
    (value,) = shown[0].summary.value
    width, height, _ = value.tensor.string_val  # the loader converts images
    assert (shown[0].step, value.tag) == (4, "steering")
    assert (int(width), int(height)) == Image.open(plot).size


def test_a_legend_lies_on_no_point() -> None:
    figure = predicted_against_true(np.ones(1), -np.ones(1), "")
    assert figure.legends
    assert figure.axes[0].get_legend() is None
