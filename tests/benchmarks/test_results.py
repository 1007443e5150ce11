"""The tables that `benchmarks/results.py` writes from `docs/results.csv`."""

import csv
import shutil
from pathlib import Path

import pytest

from benchmarks import results
from benchmarks.result_tables import (
    BEGIN,
    END,
    full_table,
    network_table,
    table_groups,
)

ROOT = Path(__file__).parents[2]
RUN = {
    "in_table": 1.0,
    "parameters": 15.0,
    "train_s": 20.0,
    "test_mse": 0.5,
    "test_zero_mse": 0.25,
    "lake_cte_mean_m": 0.2,
    "lake_cte_max_m": 1.0,
    "lake_latency_ms": 1.0,
    "mountain_interventions": 2.0,
    "command": "drivezoo train experiment=linear15 seed=1",
}


def row(model: str, setting: str, lake: float, mountain: float, **more: object) -> dict:
    driven = {"lake_autonomy": lake, "lake_interventions": round((1 - lake) * 10)}
    names = {"model": model, "setting": setting}
    return {**RUN, **names, **driven, "mountain_autonomy": mountain, **more}


ROWS = [
    row("linear", "few", 1.0, 0.5),
    row("linear", "few", 0.8, 0.7),
    row("linear", "many", 1.0, 0.25),
    row("lenet", "plain", 0.4, 0.0),
    row("lenet", "only compared", 1.0, 1.0, in_table=0.0),
    row("lenet", "never driven", 1.0, 1.0, lake_autonomy=""),
]


def test_the_full_table_has_means_and_the_worst() -> None:
    lines = full_table(table_groups(ROWS)).splitlines()
    assert len(lines) == 2 + 3
    few = "| linear | few | 15 | 2 | 20 s | 0.5000 (0.2500) | 90.0% (80.0%) | 0.20, 1.00 "
    assert lines[2] == few + "| 60.0% (50.0%) | 1.0 |"


def test_a_networks_table_has_the_commands_of_its_recipes() -> None:
    groups = [one for one in table_groups(ROWS) if one.model == "linear"]
    assert "# few\ndrivezoo train experiment=linear15\n" in network_table(groups)


def test_the_tables_are_written_between_their_markers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "docs", "docs", ignore=shutil.ignore_patterns("_build", "*.png"))
    page = Path("docs/recipes.md")
    before, _, rest = page.read_text().partition(BEGIN)
    page.write_text(f"{before}{BEGIN}\nold\n{END}{rest.partition(END)[2]}")
    results.main(["runs=false"])
    assert "docs/models/tiny.md" in capsys.readouterr().out
    for path in sorted(Path("docs").rglob("*.md")):  # nobody edited them by hand
        assert path.read_text() == (ROOT / path).read_text(), f"{path}: run results.py runs=false"


def test_a_page_without_markers_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("docs").mkdir()
    shutil.copy(ROOT / "docs" / "results.csv", "docs")
    Path("docs/recipes.md").write_text("no markers\n")
    with pytest.raises(SystemExit, match=r"docs/recipes\.md: .*<!-- results -->.*; add"):
        results.main(["runs=false"])


def test_the_file_is_read_as_it_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    results.write_csv(ROWS)
    assert results.read_csv() == ROWS
    with results.CSV.open(newline="") as file:
        assert next(csv.reader(file))[:2] == ["in_table", "parameters"]
