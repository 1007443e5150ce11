"""What runs in the process of a job, whoever started it: a laptop, a pool, Slurm, Ray."""

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, open_dict

from datamodules.errors import InputError
from zoo.cli.console_progress import loading
from zoo.cli.process_ranks import needs_processes
from zoo.cli.stop_errors import PrunedError, StoppedError
from zoo.runs.saved_config import TRUST, find_refusals
from zoo.runs.status import is_beating, read_status, write_status
from zoo.sweep.sweep_record import read_record, varying

DONE = ("finished", "pruned")
SERIAL = "basic"
LOOK_S, ORPHAN = 2.0, "end as orphan"
_training = threading.Lock()


def run_job(config: DictConfig) -> float:
    """Train one job of a sweep, from its last checkpoint where it has one.

    A failure is written down, not raised: the sweep goes on. A job that is done, or that a living
    process is training, is left alone.

    Returns the validation MSE; NaN where there is none.

    Raises:
        KeyboardInterrupt: a person stopped it; Hydra lets nothing else end a sweep.
    """
    hydra = HydraConfig.get()
    folder = Path(hydra.runtime.output_dir)
    if not _claim(folder):
        return float("nan")
    serial = hydra.runtime.choices["hydra/launcher"] == SERIAL
    if serial:
        print(_heading(folder), flush=True)
    else:
        _be_one_of_many(config)
    try:
        with _training, contextlib.nullcontext() if serial else _said_in(folder / "log.txt"):
            if needs_processes(config):
                return _train_beside(config, folder)
            return _train(config, folder)
    except StoppedError as error:
        raise KeyboardInterrupt(str(error)) from error
    except PrunedError:
        return float("nan")
    except Exception as error:
        if not isinstance(error, InputError):
            (folder / "error.txt").write_text(traceback.format_exc())
        if read_status(folder).get("status") != "failed":
            write_status(folder, "failed", reason=_first_line(error))
        return float("nan")


def _heading(folder: Path) -> str:
    """Which job of how many begins, and what is its own."""
    jobs = read_record(folder.parent).jobs
    if jobs is None:
        return f"\njob {folder.name}"
    own = varying(jobs)[tuple(jobs[int(folder.name)])]
    return f"\njob {folder.name} (0 to {len(jobs) - 1}): {own}"


def _be_one_of_many(config: DictConfig) -> None:
    """What differs in a process that others started, beside more of its kind."""
    # joblib's processes start others in a way of their own, which those do not know in their turn.
    multiprocessing.set_start_method(multiprocessing.get_all_start_methods()[0], force=True)
    if not any(one.name == ORPHAN for one in threading.enumerate()):
        watch = threading.Thread(target=_end_as_orphan, args=(os.getppid(),), name=ORPHAN)
        watch.daemon = True
        watch.start()
    if config.get("score") and not config.score.get("workers"):
        with open_dict(config.score):
            config.score.workers = 1  # not one a core: the other jobs' drives are there, too


def _end_as_orphan(parent: int) -> None:
    """A pool's process would outlive a sweep that was killed, and wait for work for good: it ends
    once its job is done."""
    while os.getppid() == parent:
        time.sleep(LOOK_S)
    with _training:
        os._exit(0)


def _claim(folder: Path) -> bool:
    """Mark the job as ours; False where it is done or another's."""
    with FileLock(folder / "status.lock"):
        if read_status(folder).get("status") in DONE or is_beating(folder):
            return False
        (folder / "error.txt").unlink(missing_ok=True)
        write_status(folder, "running")
    return True


def _train(config: DictConfig, folder: Path) -> float:
    with loading():
        import torch

        from zoo.training.run import run_experiment

    threads = torch.get_num_threads()
    if "SLURM_CPUS_PER_TASK" in os.environ:  # torch would take the whole node's
        threads = int(os.environ["SLURM_CPUS_PER_TASK"])
    torch.set_num_threads(threads)
    try:
        return run_experiment(config, folder, resume=True)
    finally:
        torch.set_num_threads(threads)  # a run may have taken fewer; the next job starts anew


def _train_beside(config: DictConfig, folder: Path) -> float:
    """Train in a process of its own, whose command Lightning can run again for each device.

    In ours the command is the sweep's: the second process would start the whole sweep once more.
    """
    # Hydra has written the job's config there, whether it has begun to train or not.
    command = [sys.executable, "-m", "zoo", f"resume={folder}"]
    if trusted := [one.trust for one in find_refusals(config)]:  # composed here, and so trusted
        command.append(f"{TRUST}={','.join(trusted)}")
    result = subprocess.run(command, stdout=sys.stdout, stderr=sys.stderr, check=False)
    if result.returncode in (130, -signal.SIGINT):
        raise StoppedError("stopped")
    if result.returncode:
        status = read_status(folder)
        died = f"its process ended with {result.returncode}"
        raise RuntimeError(status["reason"] if status.get("status") == "failed" else died)
    from zoo.runs.metrics_file import read_metrics_file

    scores = (read_metrics_file(folder).get("open_loop") or {}).get("val") or {}
    return scores.get("mse", float("nan"))


@contextlib.contextmanager
def _said_in(path: Path) -> Iterator[None]:
    """What the job prints goes to a file: several at once would garble a screen."""
    with (
        path.open("a", buffering=1) as log,
        contextlib.redirect_stdout(log),
        contextlib.redirect_stderr(log),
    ):
        yield


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
