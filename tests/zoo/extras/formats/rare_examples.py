"""Examples of the extra's formats, for the tests that every format passes."""

from pathlib import Path

import numpy as np
import pytest

from tests.contracts.test_recordings import Example, ours, replace_once
from tests.zoo.extras.formats import rare_recordings as rare


def change_log_of_2016(folder: Path) -> None:
    with pytest.importorskip("h5py").File(next((folder / "log").iterdir()), "r+") as file:
        file["steering_angle"][15] = np.nan


def change_signal_of_2k19(folder: Path) -> None:
    value = folder / "processed_log/CAN/steering_angle/value"
    signal = np.load(value)
    signal[3] = np.nan
    with value.open("wb") as file:
        np.save(file, signal)


def move_point(folder: Path) -> None:
    image = sorted(folder.iterdir())[-1]
    image.rename(folder / f"999{image.name[image.name.index('_') :]}")


def change_column(folder: Path) -> None:
    """Change the fourth row's steering in the table of a LeRobot dataset."""
    parquet = pytest.importorskip("pyarrow.parquet")
    file = folder / "data/chunk-000/file-000.parquet"
    columns = parquet.read_table(file).to_pydict()
    columns["steering"][3] = 7.5
    parquet.write_table(pytest.importorskip("pyarrow").table(columns), file)


@rare.cached
def lerobot(folder: Path) -> Path:
    pytest.importorskip("pyarrow")
    return ours("lerobot")(folder)


spoil_degrees = replace_once("\n3.jpg ", "\n3.jpg x", "data.txt")
spoil_a_frame = replace_once(",4,", ",x,", "out-key.csv")
# As `FORMATS` of tests/contracts.
RARE: dict[str, Example] = {
    "lerobot": (lerobot, change_column, r"file-000\.parquet, row 4", {}),
    "sullychen": (rare.sullychen, spoil_degrees, r"data\.txt, row 4", {}),
    "deeppicar": (rare.deeppicar, spoil_a_frame, r"out-key\.csv, row 5", {}),
    "named_images": (rare.jetracer, move_point, r"999_\S+\.jpg", {}),
    "comma2016": (rare.comma2016, change_log_of_2016, r"\.h5, row 16", {}),
    "comma2k19": (rare.comma2k19, change_signal_of_2k19, r"video\.hevc, frame", {}),
}
