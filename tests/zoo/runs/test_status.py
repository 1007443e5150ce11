"""Find the first rank before Lightning assigns ranks."""

from pathlib import Path

import pytest

from zoo.cli.process_ranks import RANKS, is_first_process
from zoo.runs.status import read_status, run_status


def started_by(monkeypatch: pytest.MonkeyPatch, **ranks: int) -> None:
    for name in RANKS:
        monkeypatch.delenv(name, raising=False)
    for name, value in ranks.items():
        monkeypatch.setenv(name, str(value))


@pytest.mark.parametrize(
    ("ranks", "first"),
    [
        ({}, True),
        # Lightning's processes: the second on this node; the first and second on another.
        ({"LOCAL_RANK": 1}, False),
        ({"NODE_RANK": 1}, False),
        ({"NODE_RANK": 1, "LOCAL_RANK": 1}, False),
        ({"NODE_RANK": 0, "LOCAL_RANK": 0}, True),
        # torchrun: the first on the second node has the local rank 0.
        ({"RANK": 2, "LOCAL_RANK": 0, "GROUP_RANK": 1}, False),
        ({"RANK": 0, "LOCAL_RANK": 0, "GROUP_RANK": 0}, True),
        # srun, and a batch script in which Lightning starts the second process.
        ({"SLURM_PROCID": 1}, False),
        ({"SLURM_PROCID": 0}, True),
        ({"SLURM_PROCID": 0, "LOCAL_RANK": 1}, False),
    ],
)
def test_the_launchers_variables_name_the_first_rank(
    ranks: dict, first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    started_by(monkeypatch, **ranks)
    assert is_first_process() is first
    assert is_first_process(several=False), "on one device the others are runs of their own"


def test_only_the_first_rank_writes_the_status(tmp_path: Path) -> None:
    with run_status(tmp_path, first=False):
        assert not list(tmp_path.iterdir())
    with run_status(tmp_path):
        assert read_status(tmp_path)["status"] == "running"
    assert read_status(tmp_path)["status"] == "finished"
