"""`make bench` runs and writes its table; tests do not judge speed."""

import json
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from benchmarks.measuring import Row, ratios
from tests.slow_members import slow
from tests.zoo.command_runs import ROOT, command, environment, run, succeed


def bench(cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    return run(cwd, *arguments, module=str(ROOT / "benchmarks" / "bench.py"), timeout=240)


@pytest.mark.parametrize(("parts", "rows"), [("feed", 1), *slow(("feed,cache,tiny", 3))])
def test_the_short_version_measures_what_it_says(parts: str, rows: int, tmp_path: Path) -> None:
    page = tmp_path / "docs" / "performance.md"
    page.parent.mkdir()
    page.write_text("before\n<!-- bench -->\nold\n<!-- end of bench -->\nafter\n")
    printed = succeed(bench(tmp_path, "short", "docs", f"ONLY={parts}"))
    content = json.loads((tmp_path / "outputs" / "bench.json").read_text())
    assert content["short"] is True
    text = page.read_text()
    assert "| feeding, " in text
    assert "old" not in text
    assert text.endswith("<!-- end of bench -->\nafter\n")
    assert content["cores"] >= 1
    assert content["versions"]["torch"]
    assert len(content["rows"]) == rows
    for row in content["rows"]:
        value = row["ratio"][len(row["ratio"]) // 2]
        assert value > 0
        assert row["what"] in printed.replace("\n", " ") or len(row["what"]) > 40
        assert row["figures"]
        if row["aim"] is None:
            assert row["met"] == ""
            continue
        reached = value >= row["aim"] if row["at_least"] else value <= row["aim"]
        assert row["met"] in ("yes" if reached else "no", "noisy")


def test_a_row_whose_aim_lies_in_the_spread_is_not_judged() -> None:
    steady = ratios([2.0, 4.2, 9.0], [1.0, 2.0, 4.5])
    assert steady == [2.0, 2.0, pytest.approx(2.05)]
    assert [Row("a", "b", steady, aim).met for aim in (1.5, 2.5, None)] == ["yes", "no", ""]
    assert Row("a", "b", [1.0, 1.5, 3.0], 1.4).met == "noisy"


def test_a_part_that_there_is_none_of_is_named(tmp_path: Path) -> None:
    result = bench(tmp_path, "ONLY=fed")
    assert result.returncode == 1
    assert result.stdout.startswith("bench: fed: no such part; available: feed, training, tiny,")


@pytest.mark.skipif(sys.platform == "win32", reason="sends POSIX signals")
def test_the_running_part_ends_with_a_benchmark_that_is_killed(tmp_path: Path) -> None:
    words = command(str(ROOT / "benchmarks" / "bench.py"), "short", "ONLY=training")
    options = {"cwd": tmp_path, "env": environment(), "stdout": subprocess.PIPE}
    with subprocess.Popen(words, **options) as benchmark:
        assert benchmark.stdout.readline() == b"training ...\n"
        process = psutil.Process(benchmark.pid)
        while not (parts := process.children()):
            assert benchmark.poll() is None
        benchmark.kill()
    assert psutil.wait_procs(parts, timeout=60)[1] == []
