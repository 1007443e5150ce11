"""The board of the benchmark: its entries, its file and its pages."""

import shutil
from pathlib import Path

import pytest

from benchmarks import board, board_page
from zoo.base.errors import InputError
from zoo.benchmark.baselines import BASELINES
from zoo.benchmark.result import NEEDED, BenchmarkResult, write_result

ROOT = Path(__file__).parents[2]
FINGERPRINT = "447ba1b97b686b27"


def interval(value: float | None, low: float | None, high: float | None) -> dict:
    return {"value": value, "low": low, "high": high}


def write_entry(folder: Path, headline: float = 0.9, **changes: object) -> Path:
    """Write the `result.json` of an entry with one checkpoint and one road."""
    checkpoint = {
        "file": "best.ckpt",
        "sha256": "0" * 64,
        "model": "LeNet",
        "parameters": 137741,
        "training_seed": 1,
        "data": FINGERPRINT,
    }
    drive = {"checkpoint": 0, "group": "like", "track": "lakeside:501", "settings": {}}
    like = {
        "autonomy": interval(0.9, 0.85, 1.0),
        "m_per_intervention": interval(None, 812.4, None),
        "without_intervention": interval(0.0, 0.0, 0.79),
        "cte_mean_m": interval(0.2, 0.15, 0.25),
        "steering_per_s": interval(0.1, 0.1, 0.1),
    }
    result = {
        "version": 1,
        "suite": "v1",
        "roads": "ab" * 8,
        "code": {"hash": "abc", "commit": None},
        "entry": "mine",
        "checkpoints": [checkpoint],
        "drives": [{**drive, "figures": dict.fromkeys(NEEDED, 1.0), "digest": "cd" * 8}],
        "groups": {"like": like},
        "headline": interval(headline, 0.8, 1.0),
        "digest": "ef" * 8,
    }
    folder.mkdir(parents=True)
    write_result(folder, BenchmarkResult(**{**result, **changes}))
    return folder


@pytest.fixture
def pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with copies of the board's pages, which is the current folder.

    The results of these tests have figures that are not those of their only drive.
    """
    for check in ("_check_sums", "_check_included_suite"):
        monkeypatch.setattr(f"zoo.benchmark.checked_result.{check}", lambda *_: None)
    monkeypatch.chdir(tmp_path)
    Path("docs/_static").mkdir(parents=True)
    for page in (board_page.PAGE, board_page.README):
        shutil.copy(ROOT / page, page)
    return tmp_path


def test_every_recipe_and_baseline_is_an_entry() -> None:
    found = board.entries(weights="vgg.pth")
    experiments = {path.stem for path in (ROOT / "conf" / "experiment").glob("*.yaml")}
    assert {*experiments, *BASELINES} <= set(found)
    assert found["lenet-with_bends"] == ("experiment=lenet", "augment=[brightness,bend]")
    assert "model.weights=vgg.pth" in found["vgg"]
    assert "vgg" not in board.entries()


def test_a_recipe_means_its_variants_too() -> None:
    chosen = board.chosen_entries(board.BoardOptions(only="pilotnet-with_bends,lenet"))
    assert list(chosen) == ["pilotnet-with_bends", "lenet", "lenet-with_bends"]


@pytest.mark.parametrize(("word", "named"), [("only=lennet", "lennet"), ("sedes=2", "sedes")])
def test_a_wrong_option_is_named(word: str, named: str) -> None:
    with pytest.raises(InputError, match=named):
        board.main([word])


def test_an_entry_stands_in_all_pages(pages: Path) -> None:
    board.add_entry(write_entry(pages / "entry"), "lenet", "whole", "drivezoo train")
    board.main(["runs=false"])
    page = board_page.PAGE.read_text()
    assert "| `lenet` | whole | 137,741 | 1 | 90.0 % (80.0 to 100.0) | 90.0 % (85.0 to" in page
    assert "0 of 1 (79 % or less)" in page
    assert "| 812 or more | 0.0 % (0.0 to 79.0) | 0.20 (0.15 to 0.25) |" in page
    assert "| LeNet | `lenet` | 137,741 | 90.0 % (80.0 to 100.0) |" in board_page.README.read_text()
    assert ">lenet</td>" in board_page.SORTS.read_text()


def test_the_best_headline_stands_first_and_for_its_network(pages: Path) -> None:
    for name, headline in (("bad", 0.5), ("good", 0.8), ("worse", 0.4)):
        board.add_entry(write_entry(pages / name, headline), name, "whole", "")
    board.main(["runs=false"])
    text = board_page.PAGE.read_text()
    assert text.index("`good`") < text.index("`bad`") < text.index("`worse`")
    assert "`good`" in board_page.README.read_text()
    assert "`bad`" not in board_page.README.read_text()


def test_a_newer_result_replaces_the_older(pages: Path) -> None:
    board.add_entry(write_entry(pages / "old", 0.5), "lenet", "whole", "")
    board.add_entry(write_entry(pages / "quick", 0.3), "lenet", "quick", "")
    board.add_entry(write_entry(pages / "new", 0.8), "lenet", "whole", "")
    headlines = [row["autonomy"] for row in board_page.read_csv() if row["group"] == "headline"]
    assert headlines == ["0.3000", "0.8000"]


def test_results_on_other_roads_do_not_stay(pages: Path) -> None:
    board.add_entry(write_entry(pages / "old", roads="0" * 16), "lenet", "whole", "")
    board.add_entry(write_entry(pages / "new"), "tiny41", "whole", "")
    assert {row["entry"] for row in board_page.read_csv()} == {"tiny41"}


def test_an_entry_trained_on_other_rows_is_refused(pages: Path) -> None:
    folder = write_entry(pages / "entry")
    result = folder / "result.json"
    result.write_text(result.read_text().replace(FINGERPRINT, "0" * 16))
    with pytest.raises(InputError, match=r"0{16}.*data=bench_v1"):
        board.add_entry(folder, "lenet", "whole", "")
    assert not board_page.CSV.exists()


def test_a_submission_without_a_card_is_refused(pages: Path) -> None:
    with pytest.raises(InputError, match=r"card\.md"):
        board.main([f"add={write_entry(pages / 'entry')}"])


def test_a_name_that_markdown_would_read_is_refused(pages: Path) -> None:
    with pytest.raises(InputError, match="letters"):
        board.main([f"add={write_entry(pages / 'entry', entry='a | <b>')}"])


def test_a_submission_of_another_suite_is_refused(pages: Path) -> None:
    with pytest.raises(InputError, match="quick"):
        board.main([f"add={write_entry(pages / 'entry', suite='v1-quick')}"])


def test_the_committed_pages_are_those_of_the_committed_figures(pages: Path) -> None:
    shutil.copy(ROOT / board_page.CSV, board_page.CSV)
    board.main(["runs=false"])
    for page in (board_page.PAGE, board_page.README, board_page.SORTS):
        assert page.read_text() == (ROOT / page).read_text(), f"{page}: run board.py runs=false"
