"""The grid of a study: its entries, each trained with several seeds, and how they are trained."""

import itertools
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, make_dataclass
from pathlib import Path
from string import Template
from typing import Any

import yaml

from zoo.base.child_process import child_environment
from zoo.base.errors import InputError
from zoo.base.key_values import read_options
from zoo.base.plain_files import read_json
from zoo.base.whole_file import json_text, write_whole

FOLDER = Path(__file__).parent / "studies"
# The last epoch: no drive chooses it, and a score of the training does not change it.
CHECKPOINT = Path("checkpoints/last.ckpt")
Files = dict[Path, str | bytes]


@dataclass(frozen=True)
class StudyOptions:
    """The keys of every study; a study's `options` are further keys, and other defaults.

    Args:
        only: names of entries, or their first parts up to `-`, separated by commas; null: all.
        seeds: largest number of training seeds of an entry.
        quick: whether to cut each training with `quick=true`; such entries stand on their own.
        threads: number of OpenMP threads of a training, and of processes that drive.
        jobs: number of parallel trainings of an entry.
        drive: whether to drive what is trained, and to write the table.
        runs: whether to train and drive; false writes the tables of the CSV file alone.
    """

    only: str | None = None
    seeds: int = 3
    quick: bool = False
    threads: int = 2
    jobs: int = 1
    drive: bool = True
    runs: bool = True


@dataclass(frozen=True)
class Entry:
    """Trainings that differ only in the seed.

    Attributes:
        name: name that `only` takes.
        labels: columns that tell the entry from others.
        words: overrides of `drivezoo train`; empty for an entry that is not trained.
        folder: folder of the runs, each named by its seed.
        seeds: number of training seeds.
        corrects: folder of the checkpoints that `drivezoo correct` corrects, with `words` as its
            keys; None for an entry of its own trainings.
    """

    name: str
    labels: dict[str, str]
    words: tuple[str, ...]
    folder: Path
    seeds: int
    corrects: str | None = None

    @property
    def runs(self) -> list[Path]:
        """Folders of all runs."""
        return [self.folder / str(seed) for seed in range(1, self.seeds + 1)]

    @property
    def finished(self) -> list[Path]:
        """Folders of the finished runs."""
        if self.corrects:
            return [run for run in self.runs if seconds_file(self.log(run)).is_file()]
        return [run for run in self.runs if (run / "metrics.json").is_file()]

    def log(self, run: Path) -> Path:
        """Return the file for the output of a run; a correction's folder holds nothing else."""
        return run.with_suffix(".txt") if self.corrects else run / "log.txt"

    def checkpoint(self, run: Path) -> Path:
        """Return the checkpoint of a finished run's last epoch, or of its last round."""
        if self.corrects:
            return Path(read_json(run / "correct.json")["rounds"][-1]["checkpoint"])
        return run / CHECKPOINT


class Study:
    """A study of `benchmarks/studies` with the options of a command.

    Args:
        name: name of the YAML file.
        arguments: options as `key=value`.

    Raises:
        InputError: there is no such study, or an option is wrong.

    Attributes:
        config: contents of the YAML file.
        options: options of `StudyOptions` and of the study.
        values: values of `$name` in overrides and folders: the options, and what was prepared.
        files: contents of the committed files that it writes, when all is measured.
    """

    def __init__(self, name: str, arguments: list[str]) -> None:
        path = FOLDER / f"{name}.yaml"
        if not path.is_file():
            studies = ", ".join(sorted(path.stem for path in FOLDER.glob("*.yaml")))
            raise InputError(f"{name}: no such study; available: {studies}")
        self.name, self.config = name, yaml.safe_load(path.read_text())
        self.options = read_options(_options_type(self.config.get("options", {})), arguments)
        self.values = dict(vars(self.options))
        self.files: Files = {}

    def entries(self) -> list[Entry]:
        """Return all entries; one whose overrides need an option that is null is left out."""
        runs = Path(filled(self.config["runs"], self.values) or "")
        entries = []
        for grid in self.config["grids"]:
            axes = grid["axes"]
            for chosen in itertools.product(*(values.items() for values in axes.values())):
                labels = dict(zip(axes, (str(name) for name, _ in chosen), strict=True))
                words = [word for _, override in chosen for word in _words(override)]
                texts = [filled(word, self.values) for word in words]
                if None in texts:
                    continue
                fixed = grid.get("labels", {}).items()
                labels |= {key: str(text).format(**labels) for key, text in fixed}
                name = self.config["name"].format(**labels).replace(",", "").replace(" ", "_")
                folder = runs / (f"{name}-quick" if self.options.quick and words else name)
                seeds = min(self.options.seeds, grid.get("seeds", self.options.seeds))
                corrects = grid.get("corrects")
                entries.append(Entry(name, labels, tuple(map(str, texts)), folder, seeds, corrects))
        return entries

    def chosen(self) -> list[Entry]:
        """Return the entries that `only` names, in its order.

        Raises:
            InputError: it names an entry that does not exist.
        """
        grid = self.entries()
        if self.options.only is None:
            return grid
        wanted = self.options.only.split(",")
        groups = {entry.name: entry.name.partition("-")[0] for entry in grid}
        if unknown := set(wanted) - {*groups, *groups.values()}:
            raise InputError(
                f"only={self.options.only}: no entry {min(unknown)}; there are {', '.join(groups)}"
            )
        return [
            entry for name in wanted for entry in grid if name in (entry.name, groups[entry.name])
        ]

    def command(self, entry: Entry, keys: str = "command") -> list[str]:
        """Return an entry's overrides with those of the study's `train` or `command`."""
        common = [filled(word, self.values) for word in self.config.get(keys, [])]
        quick = ["quick=true"] if self.options.quick else []
        words = [*entry.words, *map(str, common), *quick]
        if not any(word.startswith("trainer.precision=") for word in words):
            words.append("trainer.precision=32-true")  # a study repeats on processors without bf16
        return words

    def train(self, entry: Entry, run: Path) -> None:
        """Train or correct one seed of an entry, or resume that, unless it has finished.

        Raises:
            InputError: the training failed.
        """
        if run in entry.finished or not entry.words:
            return
        keys = self.command(entry, "train")
        words = ["zoo", *keys, f"seed={run.name}", f"hydra.run.dir={run}"]
        if (run / ".hydra" / "config.yaml").is_file():
            words = ["zoo", f"resume={run}"]
        if entry.corrects:
            checkpoint = f"{entry.corrects}/{run.name}.ckpt"
            words = ["zoo.base.console_script", "correct", checkpoint]
            words += [*entry.words, f"out={run}"]
        run_logged(entry.log(run), words, self.options.threads)
        print(f"{run}: trained", flush=True)


def _options_type(options: dict[str, Any]) -> type[StudyOptions]:
    """Return the dataclass of a study's options."""
    types: dict[str, Any] = {key.name: key.type for key in fields(StudyOptions)}
    keys = [
        (
            key,
            types.get(key, str | None if value is None else type(value)),
            field(default_factory=lambda value=value: value),
        )
        for key, value in options.items()
    ]
    return make_dataclass("Options", keys, bases=(StudyOptions,), frozen=True)


def _words(overrides: str | Sequence | dict[str, str]) -> list[str]:
    """Return overrides of the YAML, whose lists may hold lists.

    `{study: NAME, entry: NAME}` means the overrides of another study's entry.
    """
    if isinstance(overrides, str):
        return [overrides]
    if isinstance(overrides, dict):
        entries = Study(overrides["study"], []).entries()
        return next(list(entry.words) for entry in entries if entry.name == overrides["entry"])
    return [word for part in overrides for word in _words(part)]


def filled(text: str, values: Mapping[str, object]) -> str | None:
    """Return a text with its `$name` replaced; None if a value is None.

    >>> filled("data.root=$root", {"root": "lake"}), filled("$root", {"root": None})
    ('data.root=lake', None)
    """
    if None in (values[name] for name in re.findall(r"\$(\w+)", text)):
        return None
    return Template(text).substitute(values)


def write_files(files: Files) -> None:
    """Write the committed files of a study."""
    for path, contents in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, contents)


def run_logged(log: Path, words: list[str], threads: int) -> None:
    """Run `python -m WORDS` with its output in a file, and write its seconds to another.

    The command ends when this process ends, and can be resumed.

    Raises:
        InputError: the command failed; the message has its last line.
    """
    log.parent.mkdir(parents=True, exist_ok=True)
    began, before = time.perf_counter(), os.times()
    with log.open("w") as file:
        status = subprocess.run(
            [sys.executable, "-m", *words],
            stdout=file,
            stderr=subprocess.STDOUT,
            env=child_environment() | {"OMP_NUM_THREADS": str(threads)},
            check=False,
        ).returncode
    if status:
        last = " ".join(log.read_text().strip().splitlines()[-1:])
        raise InputError(f"{log.parent}: failed: {last}; see {log}")
    after = os.times()
    cpu_s = sum(after[2:4]) - sum(before[2:4])
    seconds = {"wall_s": time.perf_counter() - began, "cpu_s": cpu_s}
    write_whole(seconds_file(log), json_text(seconds))


def seconds_file(log: Path) -> Path:
    """Return the file with the seconds of a command that ended without an error."""
    return log.with_name(f"{log.stem}_seconds.json")


def kept(path: Path, measure: Callable[[], dict]) -> dict:
    """Return the figures in a JSON file; measure and write them if there is none."""
    if not path.is_file():
        figures = measure()
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json_text(figures))
        print(f"{path}: {figures}", flush=True)
    return read_json(path)
