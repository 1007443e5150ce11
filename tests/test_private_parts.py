"""Private parts of libraries, for which there is no public way: each test says who needs it."""

from importlib import import_module

import pytest

PARTS = {
    "hydra._internal.callbacks:Callbacks": "zoo.runs.run_folder.run_in_folder calls the callbacks",
    "hydra._internal.core_plugins.basic_sweeper:BasicSweeper.split_arguments": (
        "zoo.training.sweep_jobs divides a sweep into jobs"
    ),
    "lightning.fabric.strategies.launchers.subprocess_script:_ChildProcessObserver": (
        "zoo.training.distributed.Watch replaces it"
    ),
}


@pytest.mark.parametrize("part", PARTS)
def test_a_private_part_is_where_it_was(part: str) -> None:
    module, _, names = part.partition(":")
    owner = import_module(module)
    for name in names.split("."):
        owner = getattr(owner, name, None)
    assert owner is not None, f"{part} is gone: {PARTS[part]}; find another way there"


def test_lightnings_watch_of_its_processes_has_a_list() -> None:
    """`Watch` finds it among the threads, and empties its list."""
    from lightning.fabric.strategies.launchers.subprocess_script import _ChildProcessObserver

    observer = _ChildProcessObserver(main_pid=1, child_processes=[])
    assert observer._child_processes == [], "see zoo.training.distributed.Watch"
