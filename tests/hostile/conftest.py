"""Drivers' processes for hostile clients, and commands that fail with one line."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.zoo.server.conftest import driver  # noqa: F401
from tests.zoo.server.serve import Served, served
from zoo.base.run_command import run_command

Refusal = Callable[..., str]


@pytest.fixture
def fresh(tmp_path: Path) -> Iterator[Served]:
    """Start a driver for one test."""
    with served(tmp_path / "drive") as process:
        yield process


@pytest.fixture
def refusal(capsys: pytest.CaptureFixture) -> Refusal:
    """Return a function that runs a command, which must fail, and returns its one error line."""

    def run(name: str, command: Callable[[list[str]], object], arguments: list[str]) -> str:
        assert run_command(name, command, arguments) == 1
        (line,) = capsys.readouterr().err.strip().splitlines()
        return line

    return run
