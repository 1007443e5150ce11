"""The page that sets the write-ups' claims against drives."""

import csv
import shutil
from pathlib import Path

import pytest

from benchmarks import claims, claims_page
from zoo.base.errors import InputError

ROOT = Path(__file__).parents[2]
ROW = {
    "recipe": "C",
    "experiment": "tiny41",
    "data": "expert",
    "training": "published",
    "weights": "",
    "seed": "1",
    "track": "udacity_lake",
    "control": "throttle 0.2",
    "frame_rate": "15.0",
    "autonomy": "0.9",
    "interventions": "2.0",
    "cte_mean_m": "0.5",
    "cte_max_m": "3.3",
    "speed_mph": "20.0",
    "stalled_m": "",
}
CLEAN = {"seed": "2", "autonomy": "1.0", "interventions": "0.0", "cte_max_m": "1.0"}
STALLED = dict.fromkeys(claims.FIGURES, "") | {"control": "throttle 0.3", "stalled_m": "43.0"}


@pytest.fixture
def page(tmp_path, monkeypatch):
    """Return a copy of the page, in a folder of its own that is the current one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").mkdir()
    shutil.copy(ROOT / claims_page.PAGE, tmp_path / claims_page.PAGE)
    return tmp_path / claims_page.PAGE


def write_rows(rows):
    with claims_page.CSV.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(ROW))
        writer.writeheader()
        writer.writerows(rows)


def test_a_line_sets_the_claim_against_all_training_seeds(page):
    write_rows([ROW, ROW | CLEAN])
    claims.main(["runs=false"])
    (line,) = [line for line in page.read_text().splitlines() if line.startswith("| C")]
    for cell in ("drives", "95.0 % (31.5 to 100.0)", "1 of 2 (95 %: 9 to 91 %)", "0.50", "3.30"):
        assert f"| {cell} |" in line


def test_a_throttle_that_stalls_is_no_autonomy(page):
    write_rows([ROW | STALLED, ROW | STALLED | {"seed": "2", "stalled_m": "50.0"}])
    claims.main(["runs=false"])
    (line,) = [line for line in page.read_text().splitlines() if line.startswith("| C")]
    assert "| 2 of 2 stall, at 43 to 50 m |" in line
    assert "0 of 2" in line


def test_drives_that_do_not_stall_are_counted_apart(page):
    write_rows([ROW | STALLED, ROW | {"control": "throttle 0.3", "seed": "2"}])
    claims.main(["runs=false"])
    assert "1 of 2 stall, at 43 m; the others 90.0 %" in page.read_text()


def test_the_plot_needs_two_frame_rates(page):
    write_rows([ROW])
    claims.main(["runs=false"])
    assert "Not measured yet" in page.read_text()
    write_rows([ROW, ROW | {"frame_rate": "30.0"}])
    claims.main(["runs=false"])
    assert claims_page.PLOT.name in page.read_text()
    assert claims_page.PLOT.is_file()


def test_the_committed_page_is_the_one_of_the_committed_figures(page):
    shutil.copy(ROOT / claims_page.CSV, claims_page.CSV)
    claims.main(["runs=false"])
    assert page.read_text() == (ROOT / claims_page.PAGE).read_text()


def test_new_drives_replace_older_ones_of_the_same_setting(page):
    write_rows([ROW, ROW | CLEAN])
    merged = claims.merge([ROW | {"autonomy": "0.7"}])
    assert [row["autonomy"] for row in merged] == ["0.7", "1.0"]


def test_a_wrong_option_is_one_line():
    with pytest.raises(InputError, match="sedes"):
        claims.main(["sedes=2"])
