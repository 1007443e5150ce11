"""What all tests share: real recordings, and hypothesis without its clock."""

import io
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")

import pytest
from hypothesis import settings
from rich.console import Console

from tests.recordings import Written, write_recording

# Who starts the tests in the background has Ctrl-C ignored, which every process inherits; some
# tests send it to one.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples every time: a red run can be run again.
settings.register_profile("drivezoo", deadline=None, derandomize=True)
settings.load_profile("drivezoo")


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """A recording of 120 rows that tests share: read it, never change it."""
    return write_recording(tmp_path_factory.mktemp("recorded") / "lake")


@pytest.fixture
def console() -> Console:
    """Not a terminal; `console.file.getvalue()` is what was printed."""
    return Console(file=io.StringIO(), width=500)


@pytest.fixture
def small_disk(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Path]:
    """A disk of a few bytes, as its indirect parameter says: `5500k`, `8m`."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={request.param}", "none", str(place)]
    if os.name != "posix" or os.geteuid():
        pytest.skip("only root can mount a disk")
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no disk can be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)
