"""The ranking as a table in a file: its settings, seeds, figures and names."""

import csv
from pathlib import Path

import pytest

from tests.zoo.sweeps import write_run
from zoo.leaderboard.__main__ import leaderboard


def write_sweep(folder: Path) -> Path:
    """Write three training seeds of two settings that differ in one override."""
    for seed, autonomy in ((1, 0.9), (2, 1.0), (3, 0.8)):
        write_run(folder / f"a{seed}", autonomy, seed=seed, start_seeds=1)
        write_run(folder / f"b{seed}", 0.5, seed=seed, overrides=("model=lenet",), start_seeds=1)
    return folder


def rows_of(path: Path) -> list[list[str]]:
    """Return the cells of a TeX table's rows, the headings first."""
    lines = [line for line in path.read_text().splitlines() if line.endswith(r"\\")]
    return [line.removesuffix(r" \\").split(" & ") for line in lines]


def test_the_table_of_a_sweep_for_a_paper_is_short_and_has_an_interval(here: Path) -> None:
    leaderboard.main([str(write_sweep(here / "sweep")), "table=a.tex"])
    heads, first, second = rows_of(Path("a.tex"))
    assert heads[:2] == ["model", "training seeds"]
    assert len(heads) == 5
    assert first[:3] == ["tiny", "1, 2, 3 (n = 3)", r"90.0\% (65.2\% to 100.0\%)"]
    assert second[2] == r"50.0\%"
    assert str(here) not in Path("a.tex").read_text()


def test_the_table_of_a_sweep_for_programs_has_every_figure(here: Path) -> None:
    leaderboard.main([str(write_sweep(here / "sweep")), "table=a.csv"])
    with Path("a.csv").open() as file:
        first, _ = csv.DictReader(file)
    assert float(first["lake_autonomy_low"]) == pytest.approx(0.652, abs=0.001)
    assert first["rank"] == "1"
    assert {"run", "val_mse", "wall_s", "lake_drives_without_intervention"} <= set(first)


def test_true_in_capitals_is_no_other_setting(tmp_path: Path) -> None:
    for seed, word in ((1, "True"), (2, "true")):
        quick = ("model=tiny", f"quick={word}")
        write_run(tmp_path / "runs" / str(seed), 0.9, seed=seed, overrides=quick)
    write_run(tmp_path / "runs" / "3", 0.8, overrides=("model=lenet",))
    ranking = leaderboard(tmp_path / "runs")
    assert {row["quick"] for row in ranking.table()} == {"true", None}


def test_runs_of_several_folders_are_named_from_the_current_folder(here: Path) -> None:
    for name in ("a", "b"):
        write_run(here / name / "today" / "run", 0.9, overrides=(f"x={name}",))
    ranking = leaderboard(here / "a", here / "b")
    assert {row["run"] for row in ranking.table()} == {"a/today/run", "b/today/run"}
