"""How threads wait, chosen by what other programs use."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from zoo.training import openmp_threads
from zoo.training.openmp_threads import IdleTeam, choose_waiting, spinning_while_quiet

TEAM = """
import os, time, torch
from zoo.training.openmp_threads import IdleTeam, _find_openmp
count = lambda: len(os.listdir("/proc/self/task"))
openmp = _find_openmp()
if openmp is None:
    print("none")
else:
    torch.ones(1 << 20).add_(1)
    before = count()
    team = IdleTeam(openmp, 5)
    during = count()
    team.end()
    for _ in range(100):  # they end one by one
        time.sleep(0.02 * (count() > before))
    print(during - before, count() - before)
"""


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME"):
        monkeypatch.delenv(name, raising=False)


def test_where_it_cannot_be_changed_later_threads_sleep(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(openmp_threads, "STAT", tmp_path)
    choose_waiting()
    assert "OMP_WAIT_POLICY" not in os.environ
    assert os.environ["KMP_BLOCKTIME"] == "0"
    monkeypatch.setattr(openmp_threads, "STAT", tmp_path / "missing")
    choose_waiting()
    assert os.environ["OMP_WAIT_POLICY"] == "PASSIVE"


def test_who_said_how_threads_wait_is_heeded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GOMP_SPINCOUNT", "5000")
    choose_waiting()
    assert "KMP_BLOCKTIME" not in os.environ
    threads = threading.active_count()
    with spinning_while_quiet(4):
        assert threading.active_count() == threads


@pytest.mark.skipif(not openmp_threads.STAT.exists(), reason="Linux tells what others use")
def test_a_team_comes_and_goes() -> None:
    result = subprocess.run(
        [sys.executable, "-c", TEAM],
        cwd=Path(__file__).parents[3],
        capture_output=True,
        text=True,
        check=True,
    )
    # Its caller and four more, for which there is work only where torch has GNU's OpenMP.
    assert result.stdout.strip() in ("5 0", "none")


@pytest.mark.parametrize("folder", [b"my laps", b"not UTF-8 \xff"])
def test_openmp_is_found_in_any_folder(
    folder: bytes, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    place = b"7f00-7f01 r-xp 00000000 08:01 42    /" + folder
    maps = tmp_path / "maps"
    maps.write_bytes(
        place + b"/.venv/cv2/libgomp-1.so\n" + place + b"/.venv/torch/lib/libgomp.so.1\n"
    )
    monkeypatch.setattr(openmp_threads, "MAPS", maps)
    assert openmp_threads._find_openmp() is None  # it is not there, and that is no error
    monkeypatch.setattr("ctypes.CDLL", lambda path: path)
    assert openmp_threads._find_openmp() == os.fsdecode(
        b"/" + folder + b"/.venv/torch/lib/libgomp.so.1"
    )


class OpenMP:
    """A stand-in for OpenMP with four cores and no threads."""

    teams = 0

    def omp_get_num_procs(self) -> int:
        return 4

    def GOMP_parallel(self, *_: object) -> None:  # noqa: N802
        self.teams += 1


@pytest.mark.skipif(not openmp_threads.STAT.exists(), reason="Linux tells what others use")
@pytest.mark.parametrize(
    ("threads", "others", "spins"), [(4, 0.0, True), (4, 0.9, False), (2, 1.9, True), (2, 3, False)]
)
def test_threads_spin_while_others_leave_them_their_cores(
    threads: int, others: float, spins: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    began, ended = [], []
    openmp = OpenMP()
    end = IdleTeam.end

    def usage() -> tuple[float, float, float]:
        now = time.perf_counter()
        return now, 3.0 * now, (3.0 + others) * now

    monkeypatch.setattr(openmp_threads, "_usage", usage)
    monkeypatch.setattr(openmp_threads, "_find_openmp", lambda: openmp)
    monkeypatch.setattr(openmp_threads, "LOOK_EVERY_S", 0.01)
    monkeypatch.setattr(IdleTeam, "end", lambda team: ended.append(end(team)))
    with spinning_while_quiet(threads):
        time.sleep(0.3)
        began.append(openmp.teams)
        assert bool(ended) == spins
        others = 3 - others  # who was quiet is busy now, and the other way round
        time.sleep(0.3)
        began.append(openmp.teams)
    assert began == ([1, 2] if spins and threads + others > 4.7 else [1, 1])
    assert len(ended) == openmp.teams
