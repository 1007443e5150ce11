"""Garbage collection during slow imports."""

import gc
import subprocess
import sys

import pytest

from tests.frozen_objects import count_frozen
from zoo.cli.console_progress import loading

# In its own process, because the tests' process has frozen its objects.
SOURCE = """
import gc
from zoo.cli.console_progress import loading
runs = []
with loading():
    gc.callbacks.append(lambda phase, info: runs.append(info["generation"]))
    created = [[] for _ in range(100_000)]
    print(len(runs))
print(len(gc.get_objects(generation=0)) < 10_000, len(gc.get_objects(generation=2)) > 100_000)
print(gc.isenabled(), gc.get_freeze_count())
"""


def test_no_collection_runs_while_loading_and_the_next_one_skips_what_was_loaded():
    ran = subprocess.run([sys.executable, "-c", SOURCE], capture_output=True, text=True, check=True)
    assert ran.stdout.split() == ["0", "True", "True", "True", "0"]


def test_collection_resumes_after_an_error():
    def import_nothing() -> None:
        assert not gc.isenabled()
        raise ImportError("torch")

    with pytest.raises(ImportError), loading():
        import_nothing()
    assert gc.isenabled()


def test_what_the_process_has_set_is_kept():
    frozen = count_frozen()
    assert frozen  # see tests/conftest.py
    with loading():
        pass
    assert count_frozen() == frozen
    gc.disable()
    try:
        with loading():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
