"""The allocator, in processes of its own; the processor."""

import os
import platform
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest

from tests.zoo.command_runs import ROOT, run_words, succeed
from zoo.training.host_settings import SPINS, keep_freed_memory, limit_spinning, multiplies_bf16

# Takes and gives back the blocks of a training step, and says how often the kernel had to help.
STEPS = """
import resource, sys
from zoo.training.host_settings import keep_freed_memory
if "keep" in sys.argv:
    assert keep_freed_memory()
for step in range(30):
    blocks = [bytearray(20_000_000) for _ in range(3)]
    blocks.clear()
    if step == 9:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc alone gives memory back")
@pytest.mark.slow
def test_freed_memory_is_kept() -> None:
    words = (sys.executable, "-c", STEPS)
    faults = [int(succeed(run_words(ROOT, *words, *more))) for more in (["keep"], [])]
    assert faults[0] < 0.1 * faults[1]


def test_the_python_of_windows_store_is_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zoo.training.host_settings.os.name", "nt")
    monkeypatch.setattr("platform.libc_ver", Mock(side_effect=OSError))
    assert not keep_freed_memory()


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ("flags : avx512f avx512_bf16 fma", True),
        ("flags : amx_bf16", True),
        ("flags : avx2", False),
        ("Features : bf16 i8mm", None),  # ARM's, which nobody has measured
    ],
)
def test_the_processor_says_whether_it_multiplies_bf16(
    flags: str, expected: bool | None, tmp_path: Path
) -> None:
    (tmp_path / "cpuinfo").write_text(flags)
    assert multiplies_bf16(tmp_path / "cpuinfo") is expected
    assert multiplies_bf16(tmp_path / "none") is None


def test_a_wait_policy_of_the_user_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY", "KMP_BLOCKTIME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("OMP_WAIT_POLICY", "ACTIVE")
    limit_spinning()
    assert "GOMP_SPINCOUNT" not in os.environ
    monkeypatch.delenv("OMP_WAIT_POLICY")
    limit_spinning()
    assert os.environ["GOMP_SPINCOUNT"] == SPINS
    monkeypatch.delenv("GOMP_SPINCOUNT")
