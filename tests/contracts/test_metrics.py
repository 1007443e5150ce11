"""The contract of metrics and perturbations: all of drivezoo's, and those of another package."""

import json
import math
import re
import sys
from dataclasses import asdict, replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from tests.contracts.outside_package import installed
from tests.zoo.command_runs import run, succeed
from tests.zoo.written_checkpoints import write_constant
from zoo.base.parts import take_parts
from zoo.base.registry import Registry
from zoo.commands.new import TEMPLATES
from zoo.driving.drive_record import SOCKET, Drive, DriveRow
from zoo.driving.drives_table import mean_and_spread, print_drives
from zoo.driving.metrics import (
    DRIVES,
    HIGHER,
    LOWER,
    METRICS,
    NEITHER,
    REPLAYS,
    leaderboard_metrics,
    measure,
    metrics_page,
)
from zoo.driving.scenario import Scenario
from zoo.results.result import DriveRecord
from zoo.results.summary import summarize_drives
from zoo.scoring.robustness import PERTURBATIONS, perturbations_named, sweeps

ROWS = [
    DriveRow(0.1 * row, steering=0.2 * row, speed_mph=9.0 + row, cross_track_m=0.1 * row)
    for row in range(5)
]
DRIVES_OF_ROWS = {
    "embedded": Drive.of(ROWS, length_m=100.0, driven_m=2.0, track="lake"),
    "socket": Drive.of(ROWS, source=SOCKET),
    "one row": Drive.of(ROWS[:1], length_m=100.0),
}


def template(kind: str, name: str) -> str:
    """Return the code that `drivezoo new` writes."""
    return (TEMPLATES / f"{kind}.py.txt").read_text().replace("$name", name)


@pytest.mark.parametrize("drive", DRIVES_OF_ROWS)
@pytest.mark.parametrize("name", METRICS.own())
def test_a_metric_has_a_value_or_is_unknown(name: str, drive: str) -> None:
    metric = METRICS[name]
    value = metric.function(DRIVES_OF_ROWS[drive])
    assert value is None or isinstance(value, int if metric.whole else float | int)
    assert metric.direction in (HIGHER, LOWER, NEITHER)
    assert metric.function.__doc__
    for table in (DRIVES, REPLAYS):
        heading, form = metric.row(table)
        assert heading
        assert form.format(0.5)


@pytest.mark.parametrize("name", PERTURBATIONS.own())
def test_a_perturbation_changes_a_scenario_by_each_value(name: str) -> None:
    scenarios = sweeps([name], Scenario("lake", weather="random"))[name]
    assert list(scenarios) == sorted(scenarios)
    assert set(PERTURBATIONS[name].values) <= set(scenarios)
    changed = [str(asdict(scenario)) for scenario in scenarios.values()]
    assert len(set(changed)) == len(changed)


def test_a_metric_of_an_installed_package_is_a_column_of_every_table(tmp_path: Path) -> None:
    with installed(tmp_path, template("metric", "hard_turns"), "drivezoo.metrics", METRICS):
        assert list(METRICS) == [*METRICS.own(), "hard_turns"]
        figures = measure(DRIVES_OF_ROWS["embedded"])
        assert figures["hard_turns"] == 0.4
        assert leaderboard_metrics()[-1].column_heading("lake") == "hard_turns, lake"
        assert "## `hard_turns`\n\nShare of the rows" in metrics_page()
        console = Console(file=StringIO(), width=80)
        print_drives({"lake": mean_and_spread([figures])}, console)
        assert "hard_turns" in console.file.getvalue()
    assert "hard_turns" not in METRICS


@pytest.mark.parametrize("number", ["int64(3)", "float32(3)", "array(3)"])
def test_a_metric_that_returns_a_number_of_numpy_is_written(number: str, tmp_path: Path) -> None:
    code = template("metric", "mine").replace("return float(", f"return np.{number} or float(")
    with installed(tmp_path, code, "drivezoo.metrics", METRICS):
        figures = measure(DRIVES_OF_ROWS["embedded"])
    assert json.dumps(figures["mine"]) in ("3", "3.0")


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        ("return 1 / 0", "line 7: ZeroDivisionError: division by zero; correct it"),
        ("return 'fast'", "ValueError: could not convert string to float: 'fast'; return a number"),
        ("return drive.time_s", "TypeError: .*; return a number"),
    ],
)
def test_a_metric_that_fails_is_named_and_unknown(
    statement: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = "from zoo.driving.metrics import metric\n\n\n@metric('mine', '1', 'neither', 'us')\n"
    code += f"def mine(drive):\n    'Its definition.'\n    {statement}\n"
    with installed(tmp_path, code, "drivezoo.metrics", METRICS):
        measure(DRIVES_OF_ROWS["socket"])
        figures = measure(DRIVES_OF_ROWS["embedded"])  # the line is printed once
    assert math.isnan(figures.pop("mine"))
    np.testing.assert_equal(figures, measure(DRIVES_OF_ROWS["embedded"]))
    line = capsys.readouterr().err
    assert re.fullmatch(f"metric mine is unknown: outside_part: {reason}\n", line), line


@pytest.mark.parametrize("registry", [METRICS, PERTURBATIONS])
def test_a_label_names_one_entry(registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else two columns of a leaderboard, or two curves of a plot, have one name."""
    monkeypatch.setattr(registry, "_entries", dict(registry._entries))
    entry = next(iter(registry.values()))
    with pytest.raises(ValueError, match=f"{registry.kind} mine: .* has its label; change it"):
        registry.add("mine", entry, "my_part")
    registry.add("mine", replace(entry, label="mine"), "my_part")
    registry.add("mine", replace(entry, label="mine"), "my_part")  # a cell of a notebook runs again


def test_a_benchmark_has_a_users_metric_with_its_interval() -> None:
    drives = []
    for road in range(4):
        figures = measure(DRIVES_OF_ROWS["embedded"]) | {"mine": 0.25 * road}
        values = {name: value if math.isfinite(value) else None for name, value in figures.items()}
        fields = {"group": "like", "track": str(road), "settings": {}}
        drives.append(DriveRecord(checkpoint=0, **fields, figures=values, digest=""))
    figures = summarize_drives(drives).groups["like"]
    assert figures["mine"].value == 0.375
    assert figures["mine"].low < 0.375 < figures["mine"].high
    assert not {"latency_ms", "laps"} & figures.keys()


def test_a_package_without_parts_is_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    with installed(tmp_path, "def mine(drive):\n    return 1.0\n", "drivezoo.metrics", METRICS):
        assert list(METRICS) == METRICS.own()
    assert capsys.readouterr().err == "outside_part: registers no metric\n"


def test_a_part_without_a_class_or_a_decorated_function_registers_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setenv("DRIVEZOO_PARTS", "")
    monkeypatch.setattr("sys.path", sys.path.copy())
    for name, code in {
        "undecorated": "def mine(drive):\n    return 1.0\n",
        "decorated": template("metric", "mine"),
        "network": "class MyNet:\n    pass\n",
    }.items():
        (tmp_path / f"{name}.py").write_text(code)
        take_parts([f"parts={tmp_path / name}.py"])
    (line,) = capsys.readouterr().err.splitlines()
    assert "undecorated.py: registers nothing" in line
    assert "@metric" in line


def test_a_perturbation_of_an_installed_package_is_driven(tmp_path: Path) -> None:
    code = template("perturbation", "aslant")
    with installed(tmp_path, code, "drivezoo.perturbations", PERTURBATIONS):
        assert "aslant" in perturbations_named("all")
        scenarios = sweeps(["aslant"], Scenario("lake"))["aslant"]
        assert [scenario.heading for scenario in scenarios.values()] == [12.0, 0.0, -12.0]


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_command_measures_and_perturbs_with_the_users_files(workers: int, tmp_path: Path) -> None:
    for kind in ("metric", "perturbation"):
        (tmp_path / f"my_{kind}.py").write_text(template(kind, f"my_{kind}"))
    write_constant(tmp_path / "it.ckpt", 0.8)
    options = ("perturb=my_perturbation", "laps=0.02", "quality=simple", "out=out")
    words = ("it.ckpt", "parts=[my_metric.py,my_perturbation.py]", *options, f"workers={workers}")
    assert "my_metric" in succeed(run(tmp_path, *words, module="zoo.commands.evaluate"))
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["tracks"]["lake"]["my_metric"][0] > 0.9
    assert len(metrics["perturbed"]["my_perturbation"]) == 3
