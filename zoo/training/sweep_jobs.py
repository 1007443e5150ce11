"""The jobs of a sweep: composed, launched and reported; and a job in its launcher's process."""

import contextlib
import multiprocessing
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext
from omegaconf import DictConfig, OmegaConf, open_dict
from rich.console import Console

from zoo.base.child_process import run_module
from zoo.base.console_progress import loading
from zoo.base.errors import InputError, PrunedError, StoppedError
from zoo.base.process_ranks import needs_processes
from zoo.base.terminal import is_verbose, print_line, printable
from zoo.base.whole_file import write_whole
from zoo.results.ranking import folder_label
from zoo.results.scored import finished_run
from zoo.runs.saved_config import TRUST, find_refusals
from zoo.runs.status import is_alive, is_beating, read_metrics, read_status, write_status
from zoo.training.sweep_record import add_to_record, check_job, log_digest, read_record, varying

SERIAL = "basic"  # launcher that runs the jobs one by one, each of which prints its own progress
POLL_S = 0.5
DIED = "its process ended without an error: it was killed, or memory ran out"

Launch = Callable[[Sequence["Job"]], None]


@dataclass(frozen=True)
class Job:
    """A job of a sweep, in a folder named by the job's number."""

    number: int
    overrides: tuple[str, ...]
    folder: Path


def is_done(folder: Path) -> bool:
    """Return whether a job is pruned, or is finished with figures that can be read."""
    status = read_status(folder).get("status")
    return status == "pruned" or (status == "finished" and bool(read_metrics(folder)))


def sweep_grid(
    arguments: list[str], config: DictConfig, context: HydraContext, launcher: Launcher
) -> None:
    """Run every combination of values that is not done yet.

    Raises:
        HydraException, OmegaConfBaseException: a job's config is invalid; no job has run.
        InputError: an override is an interval, or the launcher cannot start a job.
    """
    folder = Path(config.hydra.sweep.dir)
    parsed = OverridesParser.create(config_loader=context.config_loader).parse_overrides(arguments)
    for override in parsed:
        if override.is_sweep_override() and not override.is_discrete_sweep():
            raise InputError(
                f"{override.get_key_element()}: a grid needs a list of values, not an interval; "
                "list values, or let Optuna choose them with hydra/sweeper=optuna"
            )
    (combinations,) = BasicSweeper.split_arguments(parsed, None)
    jobs = [
        Job(number, tuple(overrides), folder / str(number))
        for number, overrides in enumerate(combinations)
    ]
    data = recordings_of([job.overrides for job in jobs], config, context)
    add_to_record(folder, jobs=[list(job.overrides) for job in jobs], data=data)
    run_jobs(jobs, config, launcher, sweep_console(folder))


def sweep_console(folder: Path) -> Console:
    """Return the console of a sweep, on which its folder is printed."""
    console = Console(soft_wrap=True)
    print_line(console, f"sweep: {folder_label(folder, Path.cwd())}")
    return console


def recordings_of(
    jobs: Sequence[Sequence[str]],
    config: DictConfig,
    context: HydraContext,
    added: Sequence[str] = (),
) -> dict[str, str | None]:
    """Compose every job, to report mistakes before the first job starts.

    Args:
        jobs: overrides of each job.
        config: config of the sweep.
        context: Hydra's loaders.
        added: overrides that a search added, see `check_job`.

    Returns:
        By folder of each recording that the jobs read, the digest of its log.
    """
    digests: dict[str, str | None] = {}
    for overrides in jobs:
        job = context.config_loader.load_sweep_config(config, list(overrides))
        check_job(overrides, job, added)
        root = job.data.get("root") or OmegaConf.select(job, "data.record.out")
        for path in root if OmegaConf.is_list(root) else [root]:
            if path is not None and str(path) not in digests:
                digests[str(path)] = log_digest(str(path))
    return digests


def run_jobs(jobs: Sequence[Job], config: DictConfig, launcher: Launcher, console: Console) -> None:
    """Run jobs by one of Hydra's launchers; each job's folder is its number."""

    def launch(some: Sequence[Job]) -> None:
        overrides = [[*job.overrides, f"hydra.sweep.subdir='{job.number}'"] for job in some]
        launcher.launch(overrides, initial_job_idx=some[0].number)

    serial = config.hydra.runtime.choices["hydra/launcher"] == SERIAL
    with contextlib.nullcontext() if serial else watched(jobs, console):
        launch_all(launch, jobs, console)


@contextlib.contextmanager
def watched(jobs: Sequence[Job], console: Console) -> Iterator[None]:
    """Print a line when a job ends; parallel jobs print only to their log files."""
    varied = varying([job.overrides for job in jobs])
    before = {job: read_status(job.folder) for job in jobs}
    waiting = [job for job in jobs if not is_done(job.folder)]
    over = threading.Event()

    def report_ended() -> None:
        for job in list(waiting):
            status = read_status(job.folder)
            if status != before[job] and status.get("status") != "running":
                waiting.remove(job)
                number = f"{len(jobs) - len(waiting)}/{len(jobs)}  job {job.number}"
                words = number, varied[job.overrides], result_text(job.folder)
                print_line(console, ": ".join(filter(None, words)))

    def poll() -> None:
        while not over.wait(POLL_S):
            report_ended()

    thread = threading.Thread(target=poll, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        report_ended()


def result_text(folder: Path) -> str:
    """Return how the job in a folder ended: its figures, or the reason of its failure."""
    status = read_status(folder)
    run = finished_run(folder) if status.get("status") == "finished" else None
    if run is None:
        return ": ".join(filter(None, [status.get("status"), status.get("reason")]))
    figures = [] if (share := run.mean("autonomy")) is None else [f"autonomy {share:.1%}"]
    figures += [] if run.val_mse is None else [f"val MSE {run.val_mse:.4f}"]
    return ", ".join([f"finished in {run.wall_s:.0f} s", *figures])


def launch_all(launch: Launch, jobs: Sequence[Job], console: Console) -> None:
    """Launch each job that is not done once, and wait for jobs that another process trains.

    When one process of a pool is killed, the launcher can end the whole pool: the jobs that it had
    not started are launched again.

    Raises:
        InputError: the launcher cannot start any job.
    """
    waiting = [job for job in jobs if not is_done(job.folder) and not is_alive(job.folder)]
    while waiting:
        before = {job: read_status(job.folder) for job in waiting}
        broken = None
        try:
            launch(waiting)
        except Exception as error:  # launchers raise their own errors, and some raise a job's
            broken = error
        _wait(waiting, console)
        for job in waiting:
            if read_status(job.folder).get("status") == "running":
                write_status(job.folder, "failed", reason=DIED)
        untouched = [job for job in waiting if read_status(job.folder) == before[job]]
        if broken and untouched == waiting:
            reason = f"{type(broken).__name__}: {str(broken).strip()}".splitlines()[-1].strip()
            raise InputError(f"the launcher could not start a job: {reason}") from broken
        waiting = untouched if broken else []
    _wait(jobs, console)


def _wait(jobs: Sequence[Job], console: Console) -> None:
    """Wait until no process trains these jobs: workers of a killed sweep finish theirs."""
    alive = [job for job in jobs if is_alive(job.folder)]
    for job in alive:
        status = read_status(job.folder)
        print_line(
            console,
            f"job {job.number}: waiting for process {status.get('pid')} on {status.get('host')}, "
            "which is training it",
        )
    while any(is_alive(job.folder) for job in alive):
        time.sleep(POLL_S)


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
        print(printable(_heading(folder)), end="\n" if whole else ": ", flush=True)
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
            print(printable(result_text(folder)), flush=True)


def _heading(folder: Path) -> str:
    """Return the job's number and the overrides that only it has."""
    jobs = read_record(folder.parent).jobs or []
    if len(jobs) < 2:
        return f"job {folder.name}"
    changes = varying(jobs)[tuple(jobs[int(folder.name)])]
    return f"job {folder.name} (0 to {len(jobs) - 1}): {changes}"


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
        if is_done(folder) or is_beating(folder):
            return False
        (folder / "error.txt").unlink(missing_ok=True)
        write_status(folder, "running")
    return True


def _train(config: DictConfig, folder: Path) -> None:
    with loading():
        from zoo.training.run import run_experiment
    run_experiment(config, folder, resume=True, bf16=read_record(folder.parent).bf16)


def _train_in_subprocess(config: DictConfig, folder: Path) -> None:
    """Train in a subprocess, whose command Lightning can run again for each device.

    The command of this process is the sweep's: Lightning would start the whole sweep again.
    """
    # `resume=` works for a new job, too: Hydra has written the job's config to its folder.
    words = [f"resume={folder}"]
    if trusted := [refusal.trust for refusal in find_refusals(config)]:  # this sweep composed them
        words.append(f"{TRUST}={','.join(trusted)}")
    encoding = {"PYTHONIOENCODING": sys.stdout.encoding}
    if code := run_module("zoo", *words, env=encoding, stdout=sys.stdout, stderr=sys.stderr):
        raise RuntimeError(read_status(folder).get("reason", f"its process ended with {code}"))


@contextlib.contextmanager
def _output_to(path: Path) -> Iterator[None]:
    """Redirect printed output to a file: a sweep prints one line for each job."""
    with (
        path.open("a", encoding="utf-8", buffering=1) as log,
        contextlib.redirect_stdout(log),
        contextlib.redirect_stderr(log),
    ):
        yield
