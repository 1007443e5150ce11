"""`make bench` runs and writes its table; tests do not judge speed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def bench(cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, str(ROOT / "benchmarks" / "bench.py"), *arguments],
        cwd=cwd,
        env=os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )


@pytest.mark.parametrize(
    ("parts", "rows", "word"),
    [
        ("feed", 2, "readme"),
        pytest.param("feed,cache,tiny", 6, "docs", marks=pytest.mark.slow),
    ],
)
def test_the_short_version_measures_what_it_says(
    parts: str, rows: int, word: str, tmp_path: Path
) -> None:
    page = tmp_path / "docs" / "performance.md"
    page.parent.mkdir()
    page.write_text("before\n<!-- bench -->\nold\n<!-- end of bench -->\nafter\n")
    result = bench(tmp_path, "short", word, f"ONLY={parts}")
    assert result.returncode == 0, result.stdout + result.stderr
    found = json.loads((tmp_path / "outputs" / "bench.json").read_text())
    assert found["short"] is True
    text = page.read_text()
    assert "| feeding, " in text
    assert "old" not in text
    assert text.endswith("<!-- end of bench -->\nafter\n")
    assert found["cores"] >= 1
    assert found["versions"]["torch"]
    assert len(found["rows"]) == rows
    for row in found["rows"]:
        assert row["ratio"] > 0
        assert row["what"] in result.stdout.replace("\n", " ") or len(row["what"]) > 40
        assert row["figures"]
        if row["aim"] is None:
            assert row["met"] is None
            continue
        reached = row["ratio"] >= row["aim"] if row["at_least"] else row["ratio"] <= row["aim"]
        assert row["met"] == reached


def test_a_part_that_there_is_none_of_is_named(tmp_path: Path) -> None:
    result = bench(tmp_path, "ONLY=fed")
    assert result.returncode == 1
    assert result.stdout.startswith("bench: fed: no such part; available: feed, training, tiny,")


def test_every_part_can_run_alone() -> None:
    for path in (ROOT / "benchmarks").glob("*.py"):
        text = path.read_text()
        if "\ndef measure(" in text:
            assert "run_part(measure)" in text, path.name


def test_the_part_that_needs_keras_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("KERAS_PYTHON", raising=False)
    result = bench(tmp_path, "ONLY=keras_training")
    assert result.returncode == 1
    said = " ".join(result.stdout.split())
    assert "keras_training: set KERAS_PYTHON to a Python with Keras" in said
    assert "pip install tensorflow-cpu" in said
    assert "Traceback" not in said
