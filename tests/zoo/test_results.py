"""The table of runs."""

import json
from pathlib import Path

from tests.zoo.commands import ROOT, only_line, run


def test_a_finished_run_is_a_row_with_its_own_figures(run_folder: Path) -> None:
    result = run(ROOT, str(run_folder), module="zoo.results")
    assert result.returncode == 0, result.stderr
    header, rule, row = result.stdout.strip().splitlines()
    assert header.count("|") == rule.count("|") == row.count("|")
    metrics = json.loads((run_folder / "metrics.json").read_text())
    assert row.startswith("| nvidia | blocks | 252,219 |")
    for predictor in (metrics["open_loop"], metrics["baselines"]):
        figures = predictor["test"]
        mse = figures["mse"] if "mse" in figures else figures["always zero"]["mse"]
        assert f"{mse:.4f}" in row


def test_a_folder_without_figures_is_named(tmp_path: Path) -> None:
    assert "metrics.json" in only_line(run(ROOT, str(tmp_path), module="zoo.results"))
