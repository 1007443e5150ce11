"""A job of a sweep, in the process in which a launcher (pool, Slurm, Ray) runs it."""

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, open_dict

from zoo.base.child_process import child_environment, module_command
from zoo.base.errors import InputError, PrunedError, StoppedError
from zoo.base.terminal import is_verbose
from zoo.base.whole_file import write_whole
from zoo.base.written_files import note_files
from zoo.cli.console_progress import loading
from zoo.cli.process_ranks import needs_processes
from zoo.runs.saved_config import TRUST, find_refusals
from zoo.runs.status import is_beating, mark_run, read_status, write_status
from zoo.sweep.jobs import DONE, SERIAL, result_text
from zoo.sweep.sweep_record import read_record, varying


def run_job(config: DictConfig) -> None:
    """Train one job of a sweep, from its last checkpoint if there is one.

    It skips a job that is done or that a running process trains. A failure is recorded in the job's
    status and not raised, so that the other jobs run.

    Raises:
        KeyboardInterrupt: the user stopped the sweep; Hydra ends a sweep on no other exception.
    """
    hydra = HydraConfig.get()
    folder = Path(hydra.runtime.output_dir)
    if not _claim(folder):
        return
    serial = hydra.runtime.choices["hydra/launcher"] == SERIAL
    whole = serial and is_verbose()
    if serial:
        print(_heading(folder), end="\n" if whole else ": ", flush=True)
    else:
        _set_up_worker(config)
    try:
        with contextlib.nullcontext() if whole else _output_to(folder / "log.txt"):
            (_train_in_subprocess if needs_processes(config) else _train)(config, folder)
    except StoppedError as error:
        raise KeyboardInterrupt(str(error)) from error
    except PrunedError:
        pass
    except Exception as error:
        if not isinstance(error, InputError):
            write_whole(folder / "error.txt", traceback.format_exc())
        if read_status(folder).get("status") != "failed":
            reason = str(error).strip() or type(error).__name__
            write_status(folder, "failed", reason=reason.splitlines()[0])
    finally:
        if serial and not whole:
            print(result_text(folder), flush=True)


def _heading(folder: Path) -> str:
    """Return the job's number and the overrides that only it has."""
    jobs = read_record(folder.parent).jobs
    if jobs is None:
        return f"job {folder.name}"
    own = varying(jobs)[tuple(jobs[int(folder.name)])]
    return f"job {folder.name} (0 to {len(jobs) - 1}): {own}"


def _set_up_worker(config: DictConfig) -> None:
    """Prepare a process that a launcher started, one of several on the machine."""
    # joblib sets a start method of its own, which fails in subprocesses of its workers.
    multiprocessing.set_start_method(multiprocessing.get_all_start_methods()[0], force=True)
    if config.get("score") and not config.score.get("workers"):
        with open_dict(config.score):
            config.score.workers = 1  # not one per core: the other jobs drive on the same cores


def _claim(folder: Path) -> bool:
    """Mark the job as running here; return False if it is done or runs in another process."""
    with FileLock(folder / "status.lock"):
        if read_status(folder).get("status") in DONE or is_beating(folder):
            return False
        (folder / "error.txt").unlink(missing_ok=True)
        mark_run(folder)
        write_status(folder, "running")
    return True


def _train(config: DictConfig, folder: Path) -> None:
    with loading():
        import torch

        from zoo.training.run import run_experiment

    threads = torch.get_num_threads()
    # On a node of Slurm torch would use all cores.
    torch.set_num_threads(int(os.environ.get("SLURM_CPUS_PER_TASK", threads)))
    try:
        run_experiment(config, folder, resume=True)
    finally:
        torch.set_num_threads(threads)  # the run may have changed it; reset it for the next job


def _train_in_subprocess(config: DictConfig, folder: Path) -> None:
    """Train in a subprocess, whose command Lightning can run again for each device.

    The command of this process is the sweep's: Lightning would start the whole sweep again.
    """
    # `resume=` works for a new job, too: Hydra has written the job's config to its folder.
    command = module_command("zoo", f"resume={folder}")
    if trusted := [refusal.trust for refusal in find_refusals(config)]:  # this sweep composed them
        command.append(f"{TRUST}={','.join(trusted)}")
    result = subprocess.run(
        command, env=child_environment(), stdout=sys.stdout, stderr=sys.stderr, check=False
    )
    if result.returncode in (130, -signal.SIGINT):
        raise StoppedError("stopped")
    if result.returncode:
        status = read_status(folder)
        died = f"its process ended with {result.returncode}"
        raise RuntimeError(status["reason"] if status.get("status") == "failed" else died)


@contextlib.contextmanager
def _output_to(path: Path) -> Iterator[None]:
    """Redirect printed output to a file: a sweep prints one line for each job."""
    note_files(path)
    with (
        path.open("a", encoding="utf-8", buffering=1) as log,
        contextlib.redirect_stdout(log),
        contextlib.redirect_stderr(log),
    ):
        yield
