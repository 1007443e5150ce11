"""What all tests share: real recordings, and hypothesis without its clock."""

import io
import os
import signal

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
