"""`benchmarks/gpu.py` runs its whole path on a CPU, and names a missing GPU in one line."""

import subprocess
from pathlib import Path

import pytest
import torch

from tests.zoo.command_runs import ROOT, run, succeed


def gpu(cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    return run(cwd, *arguments, module=str(ROOT / "benchmarks" / "gpu.py"), timeout=900)


@pytest.mark.slow  # two trainings in processes of their own
def test_the_whole_path_runs_on_a_cpu(tmp_path: Path) -> None:
    printed = succeed(gpu(tmp_path, "tiny", "device=cpu", "short"))
    line, figures = [row for row in printed.splitlines() if "│" in row and "what" not in row]
    assert " tiny " in line
    assert "bfloat16 matrix product" in line
    assert "samples/s" in figures
    assert "from the CPU's 0 " in figures  # the same device


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a GPU")
def test_a_missing_gpu_is_one_line(tmp_path: Path) -> None:
    result = gpu(tmp_path)
    assert (result.returncode, result.stdout.count("\n"), result.stderr) == (1, 1, "")
    assert "no GPU found" in result.stdout
    assert not list(tmp_path.iterdir())


def test_an_unknown_network_is_named(tmp_path: Path) -> None:
    result = gpu(tmp_path, "nvidai", "device=cpu")
    assert result.returncode == 2
    assert "nvidai: no such network" in result.stdout
