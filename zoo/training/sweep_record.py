"""`sweep.json`: the record of a sweep's command, by which it is found, checked and resumed.

A sweep that the user types may set anything. A sweep's folder can come from another person: its
overrides may only name choices of this package, and each job's config is checked like that of a
saved run.
"""

import hashlib
import json
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from omegaconf import DictConfig, OmegaConf
from pydantic import Field

from datamodules.recording import LOG_NAME
from zoo.base.bounded_files import hash_file
from zoo.base.compose import choices, config_groups, hydra_overrides
from zoo.base.errors import InputError
from zoo.base.parts import KEY, named_parts
from zoo.base.plain_files import check_version, read_json
from zoo.base.whole_file import json_text, write_whole
from zoo.runs.code_fingerprint import package_versions
from zoo.runs.record_fields import Fields, Whole, check_fields
from zoo.runs.saved_config import TRUST, check_saved_config
from zoo.runs.status import read_metrics
from zoo.training.host_settings import multiplies_bf16

NAME = "sweep.json"
FORMAT = 1
SWEEPS = Path("outputs/sweeps")
# Overrides that may change when a sweep is resumed: they do not change what is trained.
LAUNCH_KEYS = ("hydra/launcher", "hydra.launcher", "hydra.sweep.", "hydra.verbose")
LAUNCHERS = ("basic", "joblib", "ray", "slurm", "submitit_local", "submitit_slurm")
SWEEPERS = ("basic", "grid", "optuna")
# Allowed `hydra.*` keys: numbers and names; none of them sets a class, a command or a path.
HYDRA_KEYS = (
    *(f"hydra.launcher.{key}" for key in ("n_jobs", "batch_size", "verbose")),
    *(f"hydra.launcher.{key}" for key in ("timeout_min", "nodes", "cpus_per_task", "mem_gb")),
    *(f"hydra.launcher.{key}" for key in ("gpus_per_node", "partition", "array_parallelism")),
    *(f"hydra.launcher.task.{key}" for key in ("num_cpus", "num_gpus")),
    *(f"hydra.sweeper.{key}" for key in ("n_trials", "at_once", "monitor", "study", "sampler")),
    *(f"hydra.sweeper.{key}" for key in ("seed", "pruner", "startup_trials", "warmup_epochs")),
    "hydra.sweep.subdir",  # set for each job
    "hydra.verbose",
)
PRUNING = "callbacks.pruning"  # callback that a search adds to its jobs


class SweepRecord(Fields):
    """The contents of `sweep.json`.

    Attributes:
        format: version of the file's format.
        arguments: overrides as typed, without `-m` and the sweep's folder.
        jobs: overrides of each job, in the order of their folders' numbers; None until they are
            known.
        data: by recording, the digest of its log; None for a recording that did not exist yet.
        versions: versions of the packages that change results.
        started: local time in ISO format.
        search: whether Optuna chooses the jobs; `jobs` is then None until the last one is chosen.
        bf16: whether `trainer.precision=auto` may choose bfloat16 in the jobs, on any machine; None
            in records of older versions.
    """

    format: Whole
    arguments: list[str]
    jobs: list[list[str]] | None = None
    data: dict[str, str | None] = Field(default_factory=dict)
    versions: dict[str, str] = Field(default_factory=dict)
    started: str = ""
    search: bool = False
    bf16: bool | None = None


def new_record(arguments: list[str]) -> SweepRecord:
    """Return the record of a sweep that starts now."""
    return SweepRecord(
        format=FORMAT,
        arguments=arguments,
        versions=package_versions(),
        started=datetime.now().astimezone().isoformat(timespec="seconds"),
        bf16=bool(multiplies_bf16()),
    )


def write_record(folder: Path, record: SweepRecord) -> None:
    """Replace `sweep.json` atomically; raises OSError if it cannot be written."""
    write_whole(folder / NAME, json.dumps(record.model_dump(), indent=1))


def add_to_record(folder: Path, **fields: object) -> None:
    """Change these fields of `sweep.json`."""
    write_record(folder, read_record(folder).model_copy(update=fields))


def read_record(folder: Path) -> SweepRecord:
    """Return the record of a sweep's folder.

    Raises:
        InputError: the folder holds no sweep, a damaged one, or one of another version.
    """
    path = folder / NAME
    if not path.exists():
        reason = "holds no sweep.json" if folder.is_dir() else "there is no such folder"
        raise InputError(f"{folder}: is no sweep ({reason}); name a folder of {SWEEPS}")
    try:
        record = check_fields(SweepRecord, read_json(path), path)
    except InputError as error:
        raise InputError(f"{error}; the file is damaged, start a new sweep") from None
    check_version(record.format, FORMAT, path)
    return record


def job_folders(folder: Path) -> list[Path]:
    """Return the folders of all jobs that have started, by number."""
    return sorted(
        (path for path in folder.iterdir() if path.name.isdigit() and path.is_dir()),
        key=lambda path: int(path.name),
    )


def varying(jobs: Sequence[Sequence[str]]) -> dict[tuple[str, ...], str]:
    """Return by job the overrides that the jobs do not share, as typed.

    >>> varying([("a=1", "b=1"), ("++a=2", "b=1")])
    {('a=1', 'b=1'): 'a=1', ('++a=2', 'b=1'): 'a=2'}
    >>> varying([("a=1",)])
    {('a=1',): ''}
    """
    shared = set.intersection(*map(set, jobs))
    return {
        tuple(job): " ".join(word.lstrip("+") for word in job if word not in shared) for job in jobs
    }


def is_same(record: SweepRecord, arguments: list[str]) -> bool:
    """Return whether a sweep has the same overrides, in any order, launcher excluded."""
    return sorted(_training_overrides(record.arguments)) == sorted(_training_overrides(arguments))


def in_its_order(record: SweepRecord, arguments: list[str]) -> list[str]:
    """Return the record's overrides, whose order numbers the jobs, with the launcher's typed now.

    >>> record = SweepRecord(format=1, arguments=["a=1,2", "hydra/launcher=joblib", "b=3,4"])
    >>> in_its_order(record, ["b=3,4", "a=1,2"])
    ['a=1,2', 'b=3,4']
    """
    return [*_training_overrides(record.arguments), *filter(_is_launch, arguments)]


def what_changed(folder: Path, record: SweepRecord) -> str | None:
    """Return which recording, package or part differs from that of the jobs; None if none does."""
    for root, digest in record.data.items():
        now = log_digest(root)
        if digest is not None and now != digest:
            return f"the recording in {root} {'is missing' if now is None else 'has changed since'}"
    hashes = {part.name: hash_file(part.file)[:16] for part in named_parts() if part.file}
    installed = package_versions() | hashes
    trained = [read_metrics(job).get("versions") or {} for job in job_folders(folder)]
    for versions in (record.versions, *trained):
        for name, number in versions.items():
            if installed.get(name, number) != number:
                return f"{name} was {number} and is now {installed[name]}"
    return None


def log_digest(root: str) -> str | None:
    """Return 16 hex digits of the hash of a recording's log; None if it cannot be read.

    Of a folder without a log, such as a tub, it is that of the files' names and sizes.
    """
    path = Path(root, LOG_NAME) if Path(root, LOG_NAME).exists() else Path(root)
    try:
        if not path.is_dir():
            return hash_file(path)[:16]
        inside = (file for file in path.rglob("*") if file.is_file())
        files = sorted((file.name, file.stat().st_size) for file in inside)
    except (InputError, OSError):
        return None
    return hashlib.sha256(json_text(files).encode()).hexdigest()[:16]


def _training_overrides(arguments: Iterable[str]) -> list[str]:
    return [word for word in arguments if not _is_launch(word)]


def _is_launch(word: str) -> bool:
    return word.lstrip("+~").startswith(LAUNCH_KEYS)


@dataclass(frozen=True)
class SavedSweep:
    """A sweep that is resumed from its folder.

    Attributes:
        source: file of its overrides.
        trusted: names of classes and keys that the user allows.
    """

    source: Path
    trusted: tuple[str, ...]


_resumed: ContextVar[SavedSweep | None] = ContextVar("resumed", default=None)


@contextmanager
def resumed_from(sweep: SavedSweep) -> Iterator[None]:
    """Check each job that is composed inside the `with` block, see `check_job`."""
    token = _resumed.set(sweep)
    try:
        yield
    finally:
        _resumed.reset(token)


def check_job(overrides: Sequence[str], config: DictConfig, added: Sequence[str] = ()) -> None:
    """Refuse a job of a resumed sweep whose overrides or config are not allowed.

    Args:
        overrides: overrides of the job.
        config: config composed from them.
        added: those overrides that a search added.

    Raises:
        InputError: see `check_overrides` and `check_saved_config`.
    """
    sweep = _resumed.get()
    if sweep is None:
        return
    check_overrides([word for word in overrides if word not in added], sweep)
    job = OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])
    # `check_overrides` has checked the study's address, as `hydra.sweeper.storage`.
    trusted = [*sweep.trusted, *([f"{PRUNING}.storage"] if added else [])]
    check_saved_config(job, sweep.source, trusted)


def check_overrides(overrides: Sequence[str], sweep: SavedSweep) -> None:
    """Refuse overrides that change Hydra itself, or name a choice from outside the package.

    Raises:
        InputError: an override is not allowed; the message names it and the name for `trust=`.
    """
    for flag in overrides:
        if flag.startswith("-"):
            _refuse(flag, flag.partition("=")[0], sweep)
    words = [word for word in overrides if not word.startswith("-")]
    for override in OverridesParser.create().parse_overrides(hydra_overrides(words, sweep=True)):
        key = override.get_key_element().lstrip("+~")
        if key not in sweep.trusted and not _is_allowed(override, key):
            _refuse(override.input_line or key, key, sweep)


def _is_allowed(override: Override, key: str) -> bool:
    groups: dict[str, Collection[str]] = {name: choices(name) for name in config_groups()}
    groups |= {"hydra/launcher": LAUNCHERS, "hydra/sweeper": SWEEPERS}
    if key in groups:
        return override.is_delete() or set(_chosen(override)) <= {*groups[key], "None"}
    if "/" in key or "@" in key or key == "hydra":
        return False
    return key in HYDRA_KEYS if key.startswith("hydra.") else not key.startswith(PRUNING)


def _chosen(override: Override) -> Iterator[str]:
    """Yield every choice of a group in an override, from a sweep or a list."""
    values = override.sweep_iterator() if override.is_sweep_override() else [override.value()]
    for value in values:
        yield from map(str, value if isinstance(value, list) else [value])


def _refuse(text: str, name: str, sweep: SavedSweep) -> None:
    if name in sweep.trusted:
        return
    remedy = f"if you know it and trust it, add {TRUST}={name:.200}"
    if name in config_groups():  # a choice that drivezoo lacks
        remedy = f"if it is from a file of yours, add {KEY}=FILE.py; {remedy}"
    raise InputError(
        f"{sweep.source}: {text!r:.200} is not allowed in a saved sweep, nothing was run; {remedy}"
    )
