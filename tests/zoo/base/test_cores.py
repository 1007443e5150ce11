import os

import pytest

from zoo.base import cores


@pytest.mark.parametrize(
    ("quota", "found"), [(float("inf"), 4), (16.0, 4), (2.5, 3), (2.0, 2), (0.3, 1)]
)
def test_a_container_that_gives_less_time_counts(monkeypatch, quota, found):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2, 3}, raising=False)
    monkeypatch.setattr(cores, "_container_cores", lambda: quota)
    assert cores.usable_cores() == found


def test_here():
    assert 1 <= cores.usable_cores() <= os.cpu_count()
