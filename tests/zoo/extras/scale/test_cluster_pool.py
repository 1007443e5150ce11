"""Drives as tasks of a cluster: the same figures, and errors in one line."""

import sys
from pathlib import Path

import numpy as np
import pytest

from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario

SCENARIOS = [Scenario("lake", seed, laps=0.01) for seed in range(2)]


@pytest.fixture
def checkpoint(here: Path) -> str:
    return str(write_constant(here / "best.ckpt", 0.05))


def assert_same(path: str, executor: str) -> None:
    here, there = (all_drives(path, SCENARIOS, executor=name) for name in ("processes", executor))
    for drive, other in zip(here, there, strict=True):
        np.testing.assert_array_equal(drive.cross_track_m, other.cross_track_m)
    with pytest.raises(InputError, match=r"^seed=-1: "):
        all_drives(path, [Scenario("lake", seed=-1)], executor=executor)


@pytest.mark.slow
def test_ray_gives_the_same_drives(checkpoint: str) -> None:
    pytest.importorskip("ray")
    assert_same(checkpoint, "ray")


@pytest.mark.slow
def test_submitit_gives_the_same_drives(checkpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the jobs by submitit's own executor for one machine, in place of Slurm."""
    submitit = pytest.importorskip("submitit")

    class OneMachine(submitit.LocalExecutor):
        def __init__(self, folder: Path, cluster: str) -> None:
            assert cluster == "slurm"
            super().__init__(folder)

        def update_parameters(self, **parameters: object) -> None:
            super().update_parameters(timeout_min=parameters["timeout_min"])

    monkeypatch.setattr(submitit, "AutoExecutor", OneMachine)
    assert_same(checkpoint, "slurm")


@pytest.mark.parametrize(("executor", "library"), [("ray", "ray"), ("slurm", "submitit")])
def test_a_library_that_is_missing_is_named(
    executor: str, library: str, checkpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(InputError, match=rf"executor={executor}: .*drivezoo\[{executor}\]"):
        all_drives(checkpoint, SCENARIOS, executor=executor)
