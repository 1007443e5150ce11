"""`metrics.json`: its writer, its reader and its version."""

import json
import math
from pathlib import Path

import pytest

from zoo.base.errors import InputError
from zoo.runs.metrics_file import VERSION, read_metrics_file, write_metrics_file


def test_written_metrics_are_read(tmp_path: Path) -> None:
    tracks = {"lake": {"drives": 2, "autonomy": (0.9, 0.1), "lap_s": None}}
    metrics = {"model": "tiny", "drive": {"tracks": tracks}, "wall_s": math.nan}
    path = write_metrics_file(tmp_path, metrics)
    assert json.loads(path.read_text())["version"] == VERSION
    found = read_metrics_file(tmp_path)
    assert (found["version"], found["wall_s"]) == (VERSION, None)
    assert found["drive"]["tracks"]["lake"]["autonomy"] == (0.9, 0.1)


@pytest.mark.parametrize("version", [{}, {"version": 2}, {"version": "1"}])
def test_a_file_of_an_unknown_version_is_refused(version: dict, tmp_path: Path) -> None:
    (tmp_path / "metrics.json").write_text(json.dumps(version | {"model": "tiny"}))
    with pytest.raises(InputError, match=r"metrics\.json: .*version"):
        read_metrics_file(tmp_path)
