"""The study of ImageNet weights: its splits, and a page that names what was not run."""

import csv
from pathlib import Path

import numpy as np
import pytest

from benchmarks import transfer, transfer_page
from datamodules.recording import read_recordings
from datamodules.split import split_rows
from tests.recordings import Written
from zoo.base.errors import InputError

ROW = {
    "setting": "scratch",
    "share": "0.1",
    "seed": "1",
    "samples": "4800",
    "size": "40x128",
    "train_rows": "390",
    "val_mse": "0.0086",
    "val_zero_mse": "0.004",
    "val_balanced_mae": "0.08",
    "val_zero_balanced_mae": "0.16",
    "laps": "0.1",
    "udacity_lake_autonomy": "0.9",
    "udacity_jungle_autonomy": "",
}


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a page with the markers, in a folder of its own that is the current one."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / transfer_page.PAGE
    path.parent.mkdir(parents=True)
    path.write_text(f"{transfer_page.BEGIN}\n{transfer_page.END}\n")
    return path


def write_rows(*rows: dict) -> None:
    with transfer_page.CSV.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(ROW))
        writer.writeheader()
        writer.writerows(rows)


def test_the_page_has_the_figures_and_names_what_was_not_run(page: Path) -> None:
    write_rows(ROW, ROW | {"setting": "frozen ImageNet"})
    transfer.main(["runs=false"])
    text = page.read_text()
    assert "| scratch | 10 % (390) | 1 | 0.50 | 90.0 % | - |" in text
    assert "2 trainings of 4,800 samples" in text
    assert "frozen random, 10 %, seed 1" in text.partition("Not trained: ")[2]
    assert "Not driven: 2 of 4 drives" in text
    assert transfer_page.PLOT.is_file()


def test_trainings_of_another_length_are_not_compared(page: Path) -> None:
    write_rows(ROW, ROW | {"samples": "64000", "val_balanced_mae": "0.016"})
    transfer.main(["runs=false"])
    assert "| scratch | 10 % (390) | 1 | 0.10 |" in page.read_text()


def test_a_smaller_share_has_rows_of_the_larger_one(recorded: Written) -> None:
    recording = read_recordings(str(recorded.folder))
    whole = split_rows(recording, block_s=0.5, gap_s=0.1)
    parts = [transfer.reduced(recording, whole, share) for share in transfer_page.SHARES]
    sizes = [len(part.train) for part in parts]
    assert sizes == sorted(sizes)
    assert np.array_equal(parts[-1].train, whole.train)
    for part in parts:
        assert np.isin(part.train, parts[-1].train).all()
        assert np.array_equal(part.val, whole.val)


def test_a_finished_study_trains_nothing(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = transfer.TransferOptions(samples=256, seeds=1)
    asked = []
    monkeypatch.setattr(transfer, "write_splits", lambda: None)
    monkeypatch.setattr(transfer, "csv_row", lambda training, _: ROW | vars(training))
    monkeypatch.setattr(transfer, "drive_and_keep", lambda path, *_: path.write_text("{}"))

    def train(folder: Path, words: list[str], threads: int) -> int:
        asked.append(words)
        folder.mkdir(parents=True)
        (folder / "metrics.json").touch()
        return 0

    monkeypatch.setattr(transfer, "train_logged", train)
    transfer.make_runs(options)
    assert len(asked) == 12
    transfer.make_runs(options)
    assert len(asked) == 12


@pytest.mark.parametrize(("option", "key"), [("samples=64", "samples"), ("shares=[0.2]", "shares")])
def test_a_wrong_option_is_named(option: str, key: str) -> None:
    with pytest.raises(InputError, match=key):
        transfer.main([option, "runs=false"])
