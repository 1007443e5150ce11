"""Fixtures for all tests, and settings of hypothesis."""

import io
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")
# One thread, set before torch is imported: the networks are small, and processes share the cores.
# Threads of OpenMP that wait spin: with two, the tests of policies take six times the CPU time.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
from hypothesis import settings
from rich.console import Console

from tests.kept_compositions import keep_compositions
from tests.recordings import Written, write_recording
from tests.spared_work import spare_work
from zoo.base import process_pool

# A shell that starts the tests in the background makes all processes ignore Ctrl-C; some tests
# need it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples in every run, so that a failure can be repeated; no limit on their time.
settings.register_profile("drivezoo", deadline=None, derandomize=True)
settings.load_profile("drivezoo")

keep_compositions()


def pytest_collection_finish() -> None:
    """Spare the tests what `spare_work` does, once all libraries are imported."""
    spare_work()


@pytest.fixture(scope="session", autouse=True)
def _plain_trainings() -> Iterator[None]:
    """Let trainings here write no plots and an empty report: each takes longer than a small one.

    And let them be in 32 bits on every processor, since tests name weights and figures. Those in
    processes of their own do both: `run_folder` has plots.
    """
    with pytest.MonkeyPatch.context() as monkeypatch:
        if "zoo.training.run" in sys.modules:
            monkeypatch.setattr("zoo.training.conclusion.save_plots", lambda *_: None)
            monkeypatch.setattr("zoo.training.conclusion.write_report", write_empty_report)
            monkeypatch.setattr("zoo.training.precision.multiplies_bf16", lambda: False)
        yield


def write_empty_report(folder: Path) -> Path:
    """Write a report without sections, and return its page."""
    report = folder / "report"
    report.mkdir(exist_ok=True)
    for name in ("report.md", "index.html"):
        (report / name).write_text("# Report")
    return report / "index.html"


@pytest.fixture(scope="session", autouse=True)
def _one_core() -> None:
    """Let drives run in this process unless a test asks for several: each new one imports torch.

    Commands in processes of their own do the same: see `forked_commands`.
    """
    process_pool.usable_cores = lambda: 1


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """Write a recording of 120 rows, which tests share and must not change."""
    return write_recording(tmp_path_factory.mktemp("recorded") / "lake")


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Take back the threads of a training in this process."""
    yield
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the test's folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def zoo(here: Path) -> Callable[..., subprocess.CompletedProcess]:
    """Return a function that runs `drivezoo train ARGUMENTS` in the test's folder and process."""
    from tests.zoo.command_runs import run_here

    return lambda *arguments: run_here(here, *arguments)


@pytest.fixture
def console() -> Console:
    """Return a console that is no terminal; `console.file.getvalue()` is its output."""
    return Console(file=io.StringIO(), width=500)


@pytest.fixture
def small_disk(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Path]:
    """Mount a small disk, whose size is the indirect parameter, such as `5500k` or `8m`."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={request.param}", "none", str(disk)]
    if os.name != "posix" or os.geteuid():
        pytest.skip("only root can mount a disk")
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no disk can be mounted here")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)
