"""`drivezoo train -m ...`: start a sweep, or resume it where it was stopped, and rank its jobs."""

import importlib.util
import os
import sys
from pathlib import Path

import hydra
from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins
from rich.console import Console

from zoo.base.compose import conf_folder, hydra_overrides, quote
from zoo.base.errors import InputError, StoppedError
from zoo.base.new_folder import is_held, written_folder
from zoo.base.output_files import check_output
from zoo.base.terminal import command_line, counted, print_line
from zoo.base.whole_file import refuse_links_out
from zoo.results.ranking_page import Ranking, wide_console
from zoo.runs.run_folder import check_name
from zoo.runs.saved_config import split_trust
from zoo.training import sweep_record as records
from zoo.training.sweep_jobs import is_done, run_job
from zoo.training.sweep_record import SavedSweep, check_overrides, resumed_from

MULTIRUN = ("-m", "--multirun", "hydra.mode=MULTIRUN")
FOLDER_KEY = "hydra.sweep.dir="
HYDRA_KEYS = ("hydra.sweep.", "hydra/", "hydra.launcher")  # that decide the folder
PAGE = "ranking.html"
LIBRARY_FILES = ("multirun.yaml", "study.db")  # of Hydra and Optuna
# The module that a choice needs, and the optional dependency of drivezoo that installs it.
OPTIONAL_MODULES = {
    "hydra/launcher=joblib": ("hydra_plugins.hydra_joblib_launcher", "joblib"),
    "hydra/launcher=slurm": ("hydra_plugins.hydra_submitit_launcher", "slurm"),
    "hydra/launcher=submitit_slurm": ("hydra_plugins.hydra_submitit_launcher", "slurm"),
    "hydra/launcher=submitit_local": ("hydra_plugins.hydra_submitit_launcher", "slurm"),
    "hydra/launcher=ray": ("ray", "ray"),
    "hydra/sweeper=optuna": ("optuna", "optuna"),
}


def sweep(arguments: list[str]) -> None:
    """Run a sweep, or resume the unfinished sweep of the same command.

    Raises:
        InputError: an invalid override, a missing package, a folder that holds something else or
            cannot be written; or, after the last job, jobs that failed.
        StoppedError: on Ctrl-C, with the command to resume.
    """
    arguments = [word for word in arguments if word not in MULTIRUN]
    refuse_missing(arguments)
    what = [word for word in arguments if not word.startswith(FOLDER_KEY)]
    if any(word.startswith("hydra.sweep.subdir") for word in what):
        raise InputError(
            "hydra.sweep.subdir: cannot be set, a job's folder is its number; remove the override"
        )
    folder = _composed_folder(arguments)
    if what == arguments:
        folder = find_unfinished(what, wide_console()) or folder
    elif (folder / records.NAME).is_file():
        record = records.read_record(folder)
        if not records.is_same(record, what):
            typed = command_line(record.arguments)
            raise InputError(f"{folder}: holds another sweep ({typed}); name another folder")
        _refuse_changed(folder, record)
    is_begun = (folder / records.NAME).is_file()
    if is_begun:
        what = records.in_its_order(records.read_record(folder), what)
    run_sweep(folder, what, is_begun and _all_done(folder))


def go_on(folder: Path, more: list[str]) -> None:
    """Resume a sweep, as `drivezoo sweep resume=FOLDER` does.

    Args:
        folder: folder of the sweep; it can come from another person, see
            `zoo.training.sweep_record`.
        more: overrides of the launcher or of the number of trials; `trust=...` allows names that
            `zoo.training.sweep_record` refuses.

    Raises:
        InputError, StoppedError: see `sweep`; also if `more` changes what is trained, the folder
            names what is not allowed, or the recordings have changed.
    """
    refuse_links_out(folder)
    record = records.read_record(folder)
    more, trusted = split_trust(more)
    saved = SavedSweep(folder / records.NAME, trusted)
    check_overrides(record.arguments, saved)
    may_change = (*records.LAUNCH_KEYS, "hydra.sweeper.n_trials=")
    if wrong := [word for word in more if not word.startswith(may_change)]:
        raise InputError(
            f"{wrong[0]}: cannot change when a sweep is resumed; only hydra/launcher, "
            "hydra.launcher..., hydra.sweeper.n_trials and trust can; start a new sweep"
        )
    _refuse_changed(folder, record)
    keys = {word.partition("=")[0] for word in more}
    kept = [word for word in record.arguments if word.partition("=")[0] not in keys]
    if "hydra/launcher" in keys:  # another launcher does not take the earlier one's settings
        kept = [word for word in kept if not word.startswith("hydra.launcher")]
    refuse_missing([*kept, *more])
    print_line(wide_console(), _resuming_line(folder, record))
    with resumed_from(saved):
        run_sweep(folder, [*kept, *more], finished=_all_done(folder) and not more)


def run_sweep(folder: Path, arguments: list[str], finished: bool) -> None:
    """Run the jobs in `folder` that are not done, then rank all jobs."""
    check_name(folder, "hydra.sweep.dir=")
    with written_folder(folder, FOLDER_KEY):
        is_new = not (folder / records.NAME).is_file()
        if is_new:
            check_output(folder / PAGE, key="")
            records.write_record(folder, records.new_record(arguments))
        if not finished:
            try:
                named = f"{FOLDER_KEY}{quote(str(folder.resolve()))}"
                _run_hydra([*hydra_overrides(arguments, sweep=True), named])
            except KeyboardInterrupt:
                words = ["drivezoo", "sweep", f"resume={folder}"]
                words += [word for word in arguments if word.startswith("hydra.sweeper.n_trials=")]
                again = f"resume with the same command, or: {command_line(words)}"
                raise StoppedError(f"stopped; {again}") from None
            except Exception:
                if is_new and not records.job_folders(folder):  # as after a typo
                    for name in (records.NAME, *LIBRARY_FILES):
                        (folder / name).unlink(missing_ok=True)
                raise
        conclude(folder)


def conclude(folder: Path) -> None:
    """Print the ranking of a sweep's jobs and write its page.

    Raises:
        InputError: jobs failed; the message has each job's reason.
    """
    folders = records.job_folders(folder)
    ranking = Ranking.read(folders, folder, title=counted(len(folders), "job"))
    ranking.written.append(ranking.write_page(folder / PAGE, f"Sweep {folder.name}"))
    ranking.show()
    if failed := [run for run in ranking.unranked if run.why in ("failed", "stopped")]:
        reasons = "; ".join(f"{run.folder.name}: {run.reason or 'it was killed'}" for run in failed)
        again = "the same command runs them again"
        if records.read_record(folder).search:  # which chooses other values
            words = ["drivezoo", "sweep", f"resume={folder}", "hydra.sweeper.n_trials=NUMBER"]
            again = f"to add trials: {command_line(words)}"
        raise InputError(
            f"{len(failed)} of {counted(len(folders), 'job')} failed: {reasons}; {again}"
        )


def refuse_missing(arguments: list[str]) -> None:
    """Raise InputError if a chosen launcher or sweeper is not installed."""
    for choice, (module, extra) in OPTIONAL_MODULES.items():
        if choice in arguments and importlib.util.find_spec(module) is None:
            raise InputError(
                f'{choice}: a package is not installed; pip install "drivezoo[{extra}]"'
            )


def _composed_folder(arguments: list[str]) -> Path:
    """Return the sweep's folder, from the config and the command's overrides."""
    from hydra import compose, initialize_config_dir

    _drop_shadowed()
    words = [word for word in arguments if word.startswith(HYDRA_KEYS)]
    with initialize_config_dir(str(conf_folder().resolve()), version_base="1.3"):
        config = compose("config", hydra_overrides(words), return_hydra_config=True)
        return Path(config.hydra.sweep.dir)


def _refuse_changed(folder: Path, record: records.SweepRecord) -> None:
    if changed := records.what_changed(folder, record):
        raise InputError(f"{folder}: {changed}; start a new sweep in another folder")


def find_unfinished(arguments: list[str], console: Console) -> Path | None:
    """Return the newest unfinished sweep of the same command, or None.

    It looks under `outputs/sweeps` and prints a line about its decision.
    """
    for path in sorted(records.SWEEPS.glob(f"*/*/{records.NAME}"), reverse=True):
        folder = path.parent
        try:
            record = records.read_record(folder)
        except InputError:
            continue  # damaged, or written by another version
        if not records.is_same(record, arguments) or _all_done(folder):
            continue
        if changed := records.what_changed(folder, record):
            print_line(console, f"{folder}: same command, but {changed}; starting a new sweep")
            return None
        if record.search and is_held(folder):
            continue  # another process uses this folder; processes of one study have one each
        print_line(console, _resuming_line(folder, record))
        return folder
    return None


def _resuming_line(folder: Path, record: records.SweepRecord) -> str:
    done = sum(map(is_done, records.job_folders(folder)))
    count = f" of {len(record.jobs)}" if record.jobs is not None else ""
    return (
        f"resuming the sweep of {record.started[:16].replace('T', ' ')}: {done}{count} jobs are "
        f"done; for a new sweep add {FOLDER_KEY}FOLDER"
    )


def _all_done(folder: Path) -> bool:
    record = records.read_record(folder)
    if record.jobs is None:
        return False
    return record.search or all(is_done(folder / str(job)) for job in range(len(record.jobs)))


def _drop_shadowed() -> None:
    """Remove plugins' configs that have the same name as one of our YAML files.

    Ours are complete. Hydra would merge the two, and warn in each process that this is deprecated.
    """
    Plugins.instance()  # registers the installed plugins
    for group in ("launcher", "sweeper"):
        for path in (conf_folder() / "hydra" / group).glob("*.yaml"):
            ConfigStore.instance().repo["hydra"][group].pop(path.name, None)


def _run_hydra(arguments: list[str]) -> None:
    _drop_shadowed()
    os.environ["HYDRA_FULL_ERROR"] = "1"  # raises errors, which `run_command` prints in one line
    conf = str(conf_folder().resolve())
    before, sys.argv = sys.argv, [sys.argv[0], "-m", *arguments]
    try:
        hydra.main(version_base="1.3", config_path=conf, config_name="config")(run_job)()
    finally:
        sys.argv = before
