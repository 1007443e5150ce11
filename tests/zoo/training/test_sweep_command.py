"""Sweeps that finish after being killed, failed or repeated, and their jobs in processes."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from unittest.mock import Mock

import psutil
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from rich.console import Console

from tests.recordings import Written
from tests.refusals import refusal
from tests.zoo import trainings
from tests.zoo.base.user_parts import write_network
from tests.zoo.command_runs import command, environment, only_line, run, run_here, succeed
from tests.zoo.sweeps import change_status, status, write_run
from tests.zoo.trainings import data_of
from zoo.base.bounded_files import hash_file
from zoo.base.compose import choices, conf_folder
from zoo.base.errors import InputError
from zoo.base.new_folder import hold_folder
from zoo.base.process_ranks import needs_processes
from zoo.commands.train import each_seed
from zoo.runs.status import GONE_S, is_alive, read_status, write_status
from zoo.training import start_sweep, sweep_jobs
from zoo.training.start_sweep import find_unfinished, refuse_missing
from zoo.training.sweep_jobs import Job, _heading, launch_all, watched
from zoo.training.sweep_record import (
    add_to_record,
    log_digest,
    new_record,
    read_record,
    write_record,
)

PROGRESS = "+callbacks.progress._target_=zoo.training.training_progress.TrainingProgress"
SMALL = (*trainings.SMALL, PROGRESS, "logger=csv")


def sweep(recorded: Written, *overrides: str) -> subprocess.CompletedProcess:
    """Run a sweep in this process: importing torch each time would cost minutes."""
    return run_here(Path.cwd(), "-m", *SMALL, *data_of(recorded), *overrides)


@pytest.mark.slow
def test_a_killed_sweep_resumes_where_it_stopped(recorded: Written, here: Path) -> None:
    """Kill a sweep with both its joblib processes, and finish it one by one in this process."""
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    overrides = ("seed=1,2,3", "trainer.max_epochs=12", "data.samples_per_epoch=800")
    pool = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "hydra.sweep.dir=s")
    folders = [here / "s" / str(number) for number in range(3)]
    free = {name: value for name, value in environment().items() if name != "OMP_NUM_THREADS"}
    with (here / "log.txt").open("w") as log:
        words = command("zoo", "-m", *SMALL, *data_of(recorded), *overrides, *pool)
        apart = {"stdout": log, "stderr": log, "start_new_session": True}
        process = subprocess.Popen(words, cwd=here, env=free, **apart)
    try:
        until = time.monotonic() + 120
        while True:
            log_text = (here / "log.txt").read_text()
            if "finished in" in log_text and (folders[2] / "checkpoints" / "last.ckpt").is_file():
                break
            assert process.poll() is None, log_text
            assert time.monotonic() < until
            time.sleep(0.05)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    before = [status(folder) for folder in folders]
    assert "finished" in before[:2]
    assert before[2] == "running"
    first = before.index("finished")
    metrics = (folders[first] / "metrics.json").read_bytes()
    # Processes of a pool share the cores, and print to their log files instead of the console.
    assert json.loads(metrics)["data"]["rows"] == 120
    assert "train/loss" not in log_text
    assert "train/loss" in (folders[first] / "log.txt").read_text()

    out = succeed(run_here(here, "resume=s", "hydra/launcher=basic", module="zoo.commands.sweep"))

    assert f"{before.count('finished')} of 3 jobs are done" in out
    assert [status(folder) for folder in folders] == ["finished"] * 3
    assert (folders[first] / "metrics.json").read_bytes() == metrics, "was trained twice"
    assert (folders[2] / "log.txt").read_text().count("epoch   1/") == 1, "was not resumed"
    assert "1, 2, 3" in out, "repeats are one row of the table"
    assert (here / "s" / "ranking.html").is_file()


def test_the_same_command_runs_failed_jobs_again(recorded: Written, here: Path) -> None:
    overrides = ("data.straight_threshold=2.0,0.1", "trainer.max_epochs=1")
    result = sweep(recorded, *overrides)
    assert "1 of 2 jobs failed: 0: data.straight_cap=0.5 cannot be held" in only_line(result, 1)
    jobs = [line for line in result.stdout.splitlines() if line.startswith("job ")]
    assert re.fullmatch(
        r"job 0 \(0 to 1\): data.straight_threshold=2.0: failed: .*cannot be held.*", jobs[0]
    )
    assert re.fullmatch(
        r"job 1 \(0 to 1\): data.straight_threshold=0.1: finished in \d+ s, .*", jobs[1]
    )
    assert "train/loss" not in result.stdout, "one line a job"
    (folder,) = here.glob("outputs/sweeps/*/*")
    assert [status(folder / name) for name in "01"] == ["failed", "finished"]
    assert "train/loss" in (folder / "1" / "log.txt").read_text()
    second = (folder / "1" / "metrics.json").read_bytes()
    record = read_record(folder)
    sizes = [next(word for word in job if "straight_threshold" in word) for job in record.jobs]
    assert sizes == ["data.straight_threshold=2.0", "data.straight_threshold=0.1"]
    assert list(record.data) == [str(recorded.folder)]

    again = sweep(recorded, *overrides[::-1])  # the order does not matter

    only_line(again, 1)
    assert "1 of 2 jobs are done" in again.stdout
    assert list(here.glob("outputs/sweeps/*/*")) == [folder]
    assert (folder / "1" / "metrics.json").read_bytes() == second


def test_a_job_that_lost_its_figures_is_finished_again(recorded: Written, here: Path) -> None:
    succeed(sweep(recorded, "seed=1,2", "trainer.max_epochs=1", "hydra.sweep.dir=s"))
    metrics = here / "s" / "1" / "metrics.json"
    first = json.loads(metrics.read_text())
    metrics.write_text("{")
    out = succeed(run_here(here, "resume=s", module="zoo.commands.sweep"))
    assert "1 of 2 jobs are done" in out
    assert "damaged" not in out
    assert json.loads(metrics.read_text())["open_loop"] == first["open_loop"]


def begun(folder: Path, arguments: list[str], statuses: Sequence[str], **more: object) -> Path:
    """Write the folder of a sweep whose jobs have these statuses."""
    for number, state in enumerate(statuses):
        write_status(write_run(folder / str(number)), state)
    jobs = [[f"seed={number}"] for number in range(len(statuses))]
    write_record(folder, new_record(arguments).model_copy(update={"jobs": jobs, **more}))
    return folder


def test_the_newest_unfinished_sweep_of_the_same_command_is_found(
    here: Path, console: Console
) -> None:
    sweeps = here / "outputs" / "sweeps" / "day"
    begun(sweeps / "1", ["seed=1,2", "model=tiny"], ["failed", "finished"])
    begun(sweeps / "2", ["model=tiny", "hydra/launcher=joblib", "seed=1,2"], ["running"])
    begun(sweeps / "3", ["seed=1,2", "model=tiny"], ["finished", "pruned"])
    begun(sweeps / "4", ["seed=1,2", "model=lenet"], ["failed"])
    (sweeps / "5").mkdir()
    (sweeps / "5" / "sweep.json").write_text("{")
    folder = find_unfinished(["seed=1,2", "model=tiny"], console)
    assert folder == Path("outputs/sweeps/day/2")
    assert "resuming the sweep" in console.file.getvalue()
    assert find_unfinished(["seed=1,2,3", "model=tiny"], console) is None


def test_jobs_keep_their_numbers_whatever_the_order_of_the_words(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun(here / "s", ["seed=1,2", "optim.lr=0.1,0.2", "hydra/launcher=joblib"], ["failed"])
    ran: list[list[str]] = []
    monkeypatch.setattr(start_sweep, "run_sweep", lambda folder, words, *_: ran.append(words))
    start_sweep.sweep(["optim.lr=0.1,0.2", "seed=1,2", "hydra.sweep.dir=s"])
    assert ran == [["seed=1,2", "optim.lr=0.1,0.2"]]


@pytest.mark.parametrize(
    "change", ["the recording", "a recording without a log", "a version", "a part that a job used"]
)
def test_a_sweep_whose_inputs_changed_is_not_resumed(
    change: str, here: Path, console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", sys.path.copy())
    monkeypatch.setenv("DRIVEZOO_PARTS", str(write_network(here)))
    root = here / "recording"
    root.mkdir()
    log = root / ("tub.catalog" if "without" in change else "driving_log.csv")
    log.write_text("one\n")
    folder = here / "outputs" / "sweeps" / "day" / "1"
    begun(folder, ["seed=1,2"], ["failed"], data={str(root): log_digest(str(root))})
    metrics = json.loads((folder / "0" / "metrics.json").read_text())
    metrics["versions"] = {"my_net.py": hash_file(here / "my_net.py")[:16], "my_package.nets": "1"}
    (folder / "0" / "metrics.json").write_text(json.dumps(metrics))
    assert find_unfinished(["seed=1,2"], console) is not None
    if "recording" in change:
        log.write_text("other\n")
    elif "part" in change:
        (here / "my_net.py").write_text("other\n")
    else:
        add_to_record(folder, versions={"torch": "0.1"})
    assert find_unfinished(["seed=1,2"], console) is None
    assert "new sweep" in console.file.getvalue()
    assert "new sweep" in only_line(
        run_here(here, f"resume={folder}", module="zoo.commands.sweep"), 1
    )


def test_an_unexpected_error_is_kept_and_ends_one_job(
    recorded: Written, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import zoo.training.run

    real = zoo.training.run.run_experiment

    def out_of_memory(config, folder, resume=False, **more):
        if config.seed == 1:
            write_status(folder, "running")
            raise RuntimeError("out of memory\nand much more")
        return real(config, folder, resume, **more)

    monkeypatch.setattr(zoo.training.run, "run_experiment", out_of_memory)
    result = sweep(recorded, "seed=1,2", "trainer.max_epochs=0", "hydra.sweep.dir=s")
    assert "0: out of memory; the same command" in only_line(result, 1)
    assert "in out_of_memory" in (here / "s" / "0" / "error.txt").read_text()
    assert status(here / "s" / "1") == "finished"


@pytest.mark.slow
def test_a_job_on_two_devices_does_not_start_the_sweep_again(
    recorded: Written, tmp_path: Path
) -> None:
    """Lightning runs the job's command again for the second device, not the sweep's."""
    more = (f"data.root={recorded.folder}", "trainer=ddp_cpu", "trainer.max_epochs=1", "seed=1")
    succeed(run(tmp_path, "-m", *SMALL, *more, "hydra.sweep.dir=s"))
    assert (tmp_path / "s" / "0" / "log.txt").read_text().count("epoch   1/1") == 1
    assert sorted(path.name for path in (tmp_path / "s").iterdir() if path.name.isdigit()) == ["0"]


def test_a_job_on_two_devices_prints_its_log_in_utf_8(tmp_path: Path, monkeypatch) -> None:
    ran = Mock(return_value=0)
    monkeypatch.setattr(sweep_jobs, "run_module", ran)
    with sweep_jobs._output_to(tmp_path / "log.txt"):
        sweep_jobs._train_in_subprocess(OmegaConf.create(), tmp_path)
    assert ran.call_args.kwargs["env"]["PYTHONIOENCODING"] == "utf-8"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-m", "hydra/launcher=joblb"], "joblb: no such choice; did you mean jobli"),
        (["-m", "model=tiny,nvidai"], "model=nvidai: no such choice; did you mean nvidia?"),
        (["-m", "optim.lr=interval(1,2)"], "optim.lr: "),
        (["-m", "hydra.sweep.subdir=x"], "hydra.sweep.subdir: "),
        (["-m", "hydra.sweep.dir=/proc/none"], "/proc/none: "),
        (["-m", "seed=1,2", "hydra.sweep.dir=other"], "(seed=7)"),
    ],
)
def test_a_mistake_gets_one_line_and_leaves_nothing(
    arguments: list[str], words: str, here: Path
) -> None:
    (here / "other").mkdir()
    write_record(here / "other", new_record(["seed=7"]))
    assert words in only_line(run_here(here, *arguments))
    assert [path.name for path in here.iterdir()] == ["other"]


def test_a_new_sweep_replaces_no_page_of_the_users(here: Path) -> None:
    page = here / "mine" / "ranking.html"
    page.parent.mkdir()
    page.write_text("mine")
    line = only_line(run_here(here, "-m", "seed=1,2", "hydra.sweep.dir=mine"))
    assert "mine/ranking.html: exists" in line
    assert page.read_text() == "mine"
    assert not (page.parent / "sweep.json").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "resume=FOLDER"),
        (["resume=nowhere"], "nowhere: is no sweep (there is no such folder)"),
        (["resume=run"], "run: is no sweep (holds no sweep.json)"),
        (["resume=damaged"], "damaged/sweep.json: "),
        (["resume=other", "seed=3"], "seed: no such key"),
    ],
)
def test_a_folder_that_cannot_be_resumed_gets_one_line(
    arguments: list[str], words: str, here: Path
) -> None:
    write_run(here / "run")
    for name in ("damaged", "other"):
        (here / name).mkdir()
        write_record(here / name, new_record(["seed=7"]))
    (here / "damaged" / "sweep.json").write_text('{"format": 1, "argum')
    assert words in only_line(run_here(here, *arguments, module="zoo.commands.sweep"))


def test_a_package_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda module: None)
    for choice, extra in (("launcher=joblib", "joblib"), ("launcher=slurm", "slurm")):
        with pytest.raises(InputError, match=rf'pip install "drivezoo\[{extra}\]"'):
            refuse_missing([f"hydra/{choice}"])


def test_a_sweep_that_is_running_is_not_started_twice(here: Path) -> None:
    (here / "s").mkdir()
    with hold_folder(here / "s"):
        result = run_here(here, "-m", "seed=1,2", "hydra.sweep.dir=s")
    assert "s: another process" in only_line(result, 1)


@pytest.mark.parametrize("group", ["launcher", "sweeper"])
def test_every_yaml_of_hydras_own_groups_composes(group: str) -> None:
    for name in choices(f"hydra/{group}"):
        with initialize_config_dir(str(conf_folder().resolve()), version_base="1.3"):
            config = compose("config", [f"hydra/{group}={name}"], return_hydra_config=True)
        assert config.hydra[group]["_target_"].startswith("hydra_plugins.")


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
                write_status(job.folder, "running")
                change_status(job.folder, process_started=1.0)
                raise ChildProcessError("a process of the pool ended abruptly")
            write_status(job.folder, "finished")

    launch_all(launch, jobs, console)
    assert [status(job.folder) for job in jobs] == ["finished", "failed", "finished"]
    assert launched == [[0, 1, 2], [2]]
    assert "killed" in read_status(jobs[1].folder)["reason"]


def test_the_only_job_of_a_sweep_is_named_by_its_number(here: Path, console: Console) -> None:
    folder = begun(here / "s", ["seed=0"], ["failed"])
    assert _heading(folder / "0") == "job 0"
    with watched([Job(0, ("seed=0",), folder / "0")], console):
        write_status(folder / "0", "failed", reason="no room")
    assert console.file.getvalue() == "1/1  job 0: failed: no room\n"


def test_a_launcher_that_starts_no_job_is_an_error(tmp_path: Path, console: Console) -> None:
    def launch(some: Sequence[Job]) -> None:
        raise FileNotFoundError("there is no sbatch here")

    with pytest.raises(InputError, match=r"launcher .*there is no sbatch"):
        launch_all(launch, jobs_in(tmp_path, 2), console)


def test_a_job_that_a_living_process_trains_is_not_started_twice(
    tmp_path: Path, console: Console, other_process: psutil.Process
) -> None:
    (job,) = jobs_in(tmp_path, 1)
    pid, started = other_process.pid, other_process.create_time()
    write_status(job.folder, "running")
    change_status(job.folder, pid=pid, process_started=started)
    threading.Timer(0.3, lambda: write_status(job.folder, "finished")).start()
    launch_all(lambda some: pytest.fail("started twice"), [job], console)
    assert f"waiting for process {pid}" in console.file.getvalue()
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


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["seeds=0"], "seeds=0: must be one whole number in 1..100"),
        (["seeds=2", "seeds=3"], "seeds=3: must be one"),
        (["seeds=2", "seed=7"], "drop it or seed=7"),
        (["resume=run", "seeds=2"], "drop it or resume=run"),
        (["-m", "hydra/sweeper=optuna", "seeds=2"], "drop it or hydra/sweeper=optuna"),
    ],
)
def test_a_wrong_number_of_seeds_gets_one_line(words: list[str], message: str) -> None:
    assert message in refusal(each_seed, words)


def test_seeds_are_a_sweep_over_the_training_seed(recorded: Written, here: Path) -> None:
    assert each_seed(["-m", "model=lenet,tiny", "seeds=2"])[-1] == "seed=1,2"
    short = (*SMALL, *data_of(recorded), "trainer.max_epochs=1")
    succeed(run_here(here, *short, "seeds=2", "hydra.sweep.dir=s"))
    seeds = [OmegaConf.load(here / f"s/{number}/.hydra/config.yaml").seed for number in (0, 1)]
    assert seeds == [1, 2]
    assert "(n = 2)" in (here / "s" / "ranking.html").read_text()
