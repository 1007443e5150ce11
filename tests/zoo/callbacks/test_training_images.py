"""The plots of what is fed to a network."""

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from datamodules.driving import DrivingData
from datamodules.view import View
from tests.recordings import Written
from zoo.callbacks.training_images import figure_of_fed_batch


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
    recorded: Written, tmp_path: Path, windows: dict, columns: int, rows: int
) -> None:
    settings = {"val_share": 0.0, "test_share": 0.0, "cache": None} | windows
    data = DrivingData(str(recorded.folder), View((60, 25), "yuv", (33, 100)), **settings)
    data.load(Console(file=io.StringIO()))
    (axis,) = figure_of_fed_batch(data, 11).axes
    places = np.array([text.get_position() for text in axis.texts])
    if windows.get("sequence"):
        assert len(places) == columns * rows
        assert len(np.unique(places[:, 0])) == columns
        assert len(np.unique(places[:, 1])) == rows
        assert (np.diff(places.reshape(rows, columns, 2)[:, :, 1]) == 0).all()
    else:
        assert len(places) == 11
    assert len(axis.lines) == len(places)
