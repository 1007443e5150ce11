"""The table of runs."""

import json
from pathlib import Path

from tests.zoo.commands import ROOT, only_line, run
from zoo.runs.metrics_file import write_metrics_file


def test_a_finished_run_is_a_row_with_its_own_figures(run_folder: Path) -> None:
    result = run(ROOT, str(run_folder), module="zoo.results")
    assert result.returncode == 0, result.stderr
    header, rule, row = result.stdout.strip().splitlines()
    assert header.count("|") == rule.count("|") == row.count("|")
    metrics = json.loads((run_folder / "metrics.json").read_text())
    assert row.startswith("| nvidia | blocks | 252219 |")
    for predictor in (metrics["open_loop"], metrics["baselines"]):
        figures = predictor["test"]
        mse = figures["mse"] if "mse" in figures else figures["always zero"]["mse"]
        assert f"{mse:.4g}" in row


def test_a_folder_without_figures_is_named(tmp_path: Path) -> None:
    assert "metrics.json" in only_line(run(ROOT, str(tmp_path), module="zoo.results"))


def test_an_evaluation_names_the_command_that_ranks_it(tmp_path: Path) -> None:
    tracks = {"lake": {"drives": 1, "drives_without_intervention": 1, "autonomy": [1.0, None]}}
    write_metrics_file(tmp_path, {"checkpoint": "ann.ckpt", "drives": [], "tracks": tracks})
    line = only_line(run(ROOT, str(tmp_path), module="zoo.results"))
    assert "is an evaluation" in line
    assert "drivezoo leaderboard" in line
