"""A reader of a road's survey: a CSV file of stations, headings and heights."""

from pathlib import Path

import numpy as np

from simulator.yaml_values import is_finite
from zoo.base.bounded_files import MOST_YAML_BYTES, read_text
from zoo.base.errors import InputError

COLUMNS = ("station_m", "heading_deg", "height_m")
MOST_POINTS = 10_000  # rows of a survey, and points or segments of a track


def read_survey(given: object, folder: Path) -> np.ndarray:
    """Return a survey's rows, float64 [N, 3]: station, heading in degrees, height.

    Args:
        given: value of the key `survey`: the path of a .csv file.
        folder: folder of the track's file; the survey must lie in or below it.

    Raises:
        InputError: the file cannot be read, or a row is wrong.
    """
    place = f"survey: {given}"
    if not isinstance(given, str) or "\0" in given or Path(given).is_absolute():
        raise InputError(f"{place}; must be a .csv file in the folder of this file")
    path = folder / given
    try:
        is_inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError) as error:  # such as a loop of links
        raise InputError(f"{place}: {error}") from None
    if not is_inside:
        raise InputError(f"{place}: lies outside of the folder of this file; copy it there")
    lines = read_text(path, MOST_YAML_BYTES).splitlines()
    numbered = [(at, line) for at, line in enumerate(lines, start=1) if line.strip()]
    numbered = [(at, line) for at, line in numbered if not line.startswith("#")]
    if not numbered or tuple(numbered[0][1].replace(" ", "").split(",")) != COLUMNS:
        raise InputError(f"{place}: the first row must be {','.join(COLUMNS)}")
    survey = np.array([_row(place, at, line) for at, line in numbered[1:]]).reshape(-1, 3)
    if not 4 <= len(survey) <= MOST_POINTS:
        raise InputError(f"{place}: {len(survey):,} rows; must have 4..{MOST_POINTS:,}")
    steps = np.diff(survey[:, 0])
    if steps.min() < 1:
        at = numbered[1 + int(steps.argmin()) + 1][0]
        raise InputError(f"{place}: line {at}: each station must be 1 m or more after the last")
    return survey


def _row(place: str, at: int, line: str) -> list[float]:
    try:
        values = [float(cell) for cell in line.split(",")]
    except ValueError:
        values = []
    if len(values) != len(COLUMNS) or not all(is_finite(value) for value in values):
        raise InputError(f"{place}: line {at}: {line[:80]!r}; must be three numbers")
    return values
