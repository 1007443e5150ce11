"""Drives in several processes: their results, and how they end."""

import os
import signal

import pytest

from datamodules.errors import InputError
from zoo.scoring.pool import drive_in_processes


def half(number: int) -> tuple[float, int]:
    """Stands for a drive."""
    return number / 2, os.getpid()


def end(number: int) -> None:
    """A process that the system ends, as where memory runs out."""
    os.kill(os.getpid(), signal.SIGKILL)


def refuse(number: int) -> None:
    raise InputError(f"drive {number} cannot be")


def test_results_come_with_the_number_of_their_job() -> None:
    found = dict(drive_in_processes(half, [(4,), (6,), (8,)], workers=2))
    assert {number: value for number, (value, _) in found.items()} == {0: 2.0, 1: 3.0, 2: 4.0}
    assert os.getpid() not in {process for _, process in found.values()}


def test_one_worker_is_this_process() -> None:
    found = dict(drive_in_processes(half, [(4,), (6,)], workers=1))
    assert found == {0: (2.0, os.getpid()), 1: (3.0, os.getpid())}


def test_a_process_that_is_killed_is_told_with_what_to_try() -> None:
    with pytest.raises(InputError, match="ended from outside; try workers=1"):
        dict(drive_in_processes(end, [(1,), (2,)], workers=2))


def test_what_a_drive_raises_is_raised() -> None:
    with pytest.raises(InputError, match=r"drive \d cannot be"):
        dict(drive_in_processes(refuse, [(1,), (2,)], workers=2))
