"""Jobs and their processes: which run, which were killed, and which run again."""

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import psutil
import pytest
from omegaconf import OmegaConf
from rich.console import Console

from tests.zoo.sweeps import change_status
from zoo.base.errors import InputError
from zoo.cli.process_ranks import needs_processes
from zoo.runs.status import GONE_S, is_alive, read_status, write_status
from zoo.sweep.jobs import Job, launch_all


def status(folder: Path) -> str:
    return read_status(folder).get("status")


def test_the_process_of_a_run_is_known_by_its_number_and_start(tmp_path: Path) -> None:
    write_status(tmp_path, "running")
    assert is_alive(tmp_path)
    change_status(tmp_path, process_started=read_status(tmp_path)["process_started"] - 100)
    assert not is_alive(tmp_path), "another process was given its number"
    write_status(tmp_path, "finished")
    assert not is_alive(tmp_path)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    write_status(tmp_path, "running")
    change_status(tmp_path, pid=ended.pid)
    assert not is_alive(tmp_path)


def test_a_run_on_another_machine_lives_while_it_touches_its_file(tmp_path: Path) -> None:
    write_status(tmp_path, "running")
    change_status(tmp_path, host=f"not-{socket.gethostname()}", pid=1)
    assert is_alive(tmp_path)
    long_ago = time.time() - GONE_S - 1
    os.utime(tmp_path / "status.json", (long_ago, long_ago))
    assert not is_alive(tmp_path)


def jobs_in(folder: Path, count: int) -> list[Job]:
    jobs = [Job(number, (f"seed={number}",), folder / str(number)) for number in range(count)]
    for job in jobs:
        job.folder.mkdir()
    return jobs


def begin_and_die(job: Job) -> None:
    write_status(job.folder, "running")
    change_status(job.folder, process_started=1.0)


def test_a_process_that_dies_fails_its_job_and_the_others_are_launched_again(
    tmp_path: Path, console: Console
) -> None:
    """One killed process ends the whole pool."""
    jobs = jobs_in(tmp_path, 3)
    launched: list[list[int]] = []

    def launch(some: Sequence[Job]) -> None:
        launched.append([job.number for job in some])
        for job in some:
            if job.number == 1:
                begin_and_die(job)
                raise ChildProcessError("a process of the pool ended abruptly")
            write_status(job.folder, "finished")

    launch_all(launch, jobs, console)
    assert [status(job.folder) for job in jobs] == ["finished", "failed", "finished"]
    assert launched == [[0, 1, 2], [2]]
    assert "killed" in read_status(jobs[1].folder)["reason"]


def test_a_launcher_that_starts_no_job_is_an_error(tmp_path: Path, console: Console) -> None:
    def launch(some: Sequence[Job]) -> None:
        raise FileNotFoundError("there is no sbatch here")

    with pytest.raises(InputError, match=r"launcher .*there is no sbatch"):
        launch_all(launch, jobs_in(tmp_path, 2), console)


def test_a_job_that_a_living_process_trains_is_not_started_twice(
    tmp_path: Path, console: Console
) -> None:
    (job,) = jobs_in(tmp_path, 1)
    other = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    try:
        write_status(job.folder, "running")
        started = psutil.Process(other.pid).create_time()
        change_status(job.folder, pid=other.pid, process_started=started)
        threading.Timer(0.3, lambda: write_status(job.folder, "finished")).start()
        launch_all(lambda some: pytest.fail("started twice"), [job], console)
    finally:
        other.kill()
        other.wait()
    assert f"waiting for process {other.pid}" in console.file.getvalue()
    assert status(job.folder) == "finished"


@pytest.mark.parametrize(
    ("trainer", "several"),
    [
        ({"devices": 1, "strategy": "auto"}, False),
        ({"devices": [0], "strategy": "auto"}, False),
        ({"devices": 2, "strategy": "auto"}, True),
        ({"devices": "auto", "strategy": "auto"}, True),
        ({"devices": 1, "strategy": "ddp"}, True),
        ({"devices": 1, "strategy": "auto", "num_nodes": 2}, True),
    ],
)
def test_jobs_on_several_devices_need_processes(trainer: dict, several: bool) -> None:
    assert needs_processes(OmegaConf.create({"trainer": trainer})) is several
