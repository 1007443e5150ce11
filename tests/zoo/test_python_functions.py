"""The commands as functions: the same figures and files as the commands, and errors to catch."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest

import drivezoo
from drivezoo.training import Training
from tests.recordings import Written
from tests.zoo.written_checkpoints import write_constant

SHORT = {"laps": 0.02, "quality": "simple", "workers": 1}


@pytest.fixture(scope="module")
def run(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Training:
    """Train as the fixture `run_folder` does, but with the function."""
    cwd = tmp_path_factory.mktemp("work")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(cwd)
        return drivezoo.train(
            model="nvidia",
            data={"root": recorded.folder, "block_s": 0.5, "gap_s": 0.1, "batch_size": 16},
            trainer={"max_epochs": 2},
            score={"laps": 0.02},
            hydra={"run": {"dir": "run"}},
        )


def figures_of(folder: Path) -> dict:
    metrics = json.loads((folder / "metrics.json").read_text())
    return {key: metrics[key] for key in ("open_loop", "best_epoch", "epochs", "parameters")}


def test_a_training_has_the_commands_figures(run: Training, run_folder: Path) -> None:
    assert figures_of(run.folder) == figures_of(run_folder)
    assert run.checkpoint == run.folder / "checkpoints" / "best.ckpt"
    assert "nvidia" in repr(run)
    (row,) = run.table()
    assert row["test_mse"] == run.metrics["open_loop"]["test"]["mse"]
    assert row["lake_autonomy"] == run.metrics["drive"]["tracks"]["lake"]["autonomy"][0]


def test_a_checkpoint_and_its_policy_drive_alike(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = write_constant(tmp_path / "best.ckpt", 0.05)
    of_file = drivezoo.evaluate(path, track="lake", out="a", table="a.csv", **SHORT)
    of_function = drivezoo.evaluate(lambda frame, mph: (0.05, None), out="b", **SHORT)

    (row,) = of_file.table()
    (written,) = csv.DictReader((tmp_path / "a.csv").open())
    assert row["track"] == written["track"] == "lake"
    assert row["cte_mean_m"] == float(written["cte_mean_m"]) > 0
    assert of_function.table()[0]["cte_mean_m"] == pytest.approx(row["cte_mean_m"], rel=1e-6)
    assert "lake: autonomy" in repr(of_file)
    assert "<table>" in of_file._repr_html_()
    assert json.loads((tmp_path / "b" / "metrics.json").read_text())["checkpoint"] == "<lambda>"


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [
        (lambda: drivezoo.train(modle="nvidia"), drivezoo.UsageError, "did you mean model"),
        (lambda: drivezoo.train(trainer={"max_epohcs": 1}), drivezoo.UsageError, "max_epochs"),
        (lambda: drivezoo.train(data={"root": "no"}), drivezoo.InputError, "no:"),
        (lambda: drivezoo.train(trainer={"devices": 2}), drivezoo.UsageError, "devices=1"),
        (lambda: drivezoo.evaluate("no.ckpt"), drivezoo.InputError, "no.ckpt: no such checkpoint"),
        (lambda: drivezoo.evaluate("no.ckpt", trakc="x"), drivezoo.UsageError, "mean track"),
        (lambda: drivezoo.evaluate("no.ckpt", laps="x"), drivezoo.UsageError, "laps=x: must be"),
    ],
)
def test_a_wrong_call_raises_one_line(
    call, kind: type[Exception], words: str, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = sys.argv
    with pytest.raises(kind) as failed:
        call()
    assert words in str(failed.value)
    assert "\n" not in str(failed.value)
    assert len(failed.traceback) < 5  # the test, the call and the function
    assert sys.argv is before


def test_the_import_is_cheap() -> None:
    source = (
        "import sys, drivezoo; print(*{'torch', 'hydra', 'matplotlib', 'cv2'} & {*sys.modules})"
    )
    done = subprocess.run(
        [sys.executable, "-c", source], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []
