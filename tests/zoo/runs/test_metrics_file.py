"""`metrics.json`: one writer, one reader, and a version."""

import json
import math
from pathlib import Path

import pytest

from zoo.runs.metrics_file import VERSION, read_metrics_file, write_metrics_file

KEPT = Path(__file__).with_name("run_of_0_1_0")


def test_what_is_written_is_read(tmp_path: Path) -> None:
    tracks = {"lake": {"drives": 2, "autonomy": (0.9, 0.1), "lap_s": None}}
    metrics = {"model": "tiny", "drive": {"tracks": tracks}, "wall_s": math.nan}
    path = write_metrics_file(tmp_path, metrics)
    assert json.loads(path.read_text())["version"] == VERSION
    found = read_metrics_file(tmp_path)
    assert (found["version"], found["wall_s"]) == (VERSION, None)
    assert found["drive"]["tracks"]["lake"]["autonomy"] == [0.9, 0.1]


def test_a_file_without_a_version_is_upgraded() -> None:
    found = read_metrics_file(KEPT)
    assert found["version"] == VERSION
    assert found["drive"]["tracks"]["lake"]["autonomy"] == (0.0, None)


def test_the_first_versions_deviation_is_converted(tmp_path: Path) -> None:
    figures = {"autonomy": [0.9, (2 / 3) ** 0.5 / 10], "interventions": [0.0, 0.0], "lap_s": None}
    old = {"drive": {"seeds": 3, "tracks": {"lake": figures, "mountain": None}}}
    (tmp_path / "metrics.json").write_text(json.dumps(old))
    tracks = read_metrics_file(tmp_path)["drive"]["tracks"]
    assert tracks["lake"]["autonomy"] == (0.9, pytest.approx(0.1))
    assert tracks["lake"]["drives_without_intervention"] == 3
    assert tracks["mountain"] is None
