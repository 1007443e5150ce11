"""A training of seconds in the test's folder, and another process."""

import subprocess
import sys
from collections.abc import Callable, Iterator

import psutil
import pytest

from tests.recordings import Written
from tests.zoo.command_runs import Zoo, succeed
from tests.zoo.trainings import SMALL, data_of


@pytest.fixture
def train(zoo: Zoo, recorded: Written) -> Callable[..., str]:
    """Return a function that trains with more keys in `run`, and returns what was printed."""
    return lambda *keys: succeed(zoo(*SMALL, *data_of(recorded), "hydra.run.dir=run", *keys))


@pytest.fixture
def other_process() -> Iterator[psutil.Process]:
    """Yield a process that runs during the test."""
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    yield psutil.Process(process.pid)
    process.communicate()
