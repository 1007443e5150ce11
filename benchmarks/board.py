"""Fill the benchmark's board: `python benchmarks/board.py [only=lenet,pilotnet] [seeds=3]`.

It trains each recipe with several training seeds on `data=bench_v1` alone, and drives the suite v1
with the checkpoints as one entry (`drivezoo benchmark`). The baselines are driven, too. The
script writes `docs/benchmark.csv`, and from it the tables of `docs/benchmark.md` and `README.md`
and the page that sorts, `docs/_static/board.html`; `runs=false` writes these alone.

Runs are kept in `outputs/board`. Finished trainings and benchmarks are not repeated, so that an
interrupted command resumes. `drive=false` only trains. `add=FOLDER` verifies a submitted entry by
driving all its drives again, and adds it to the board.
"""

import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from omegaconf import OmegaConf
from rich.console import Console

from benchmarks.board_page import CSV, DATA, csv_rows, merge, read_csv, write_csv, write_pages
from benchmarks.recipes import table_recipes
from benchmarks.results import run_logged, train_logged
from simulator.command_line import read_options
from zoo.base.errors import InputError
from zoo.benchmark.baselines import BASELINES
from zoo.cli.compose import compose_config, conf_folder

RUNS = Path("outputs/board")
SUITE = "v1"
NAMES = {"nvidia": "pilotnet", "tiny": "tiny41"}  # networks by the name of their recipe


@dataclass(frozen=True)
class BoardOptions:
    """Options of the runs.

    Args:
        only: names of entries, or of recipes with their variants, separated by commas; null: all.
        seeds: number of training seeds.
        quick: whether to cut each training with `quick=true`; such entries stand on their own.
        weights: file of VGG16's ImageNet weights; without it the entry `vgg` is left out.
        suite: suite to drive; with another one than v1 no table is written.
        threads: number of OpenMP threads of a training, and of processes that drive.
        drive: whether to drive the suite; false only trains.
        runs: whether to train and drive; false writes the tables of `docs/benchmark.csv` alone.
        add: folder of a submitted entry, with `result.json` and `command.txt`; null for none.
    """

    only: str | None = None
    seeds: int = 3
    quick: bool = False
    weights: str | None = None
    suite: str = SUITE
    threads: int = 2
    drive: bool = True
    runs: bool = True
    add: str | None = None


def entries(weights: str | None = None) -> dict[str, tuple[str, ...]]:
    """Return the entries' names, and the overrides of `drivezoo train` that train them.

    A baseline has none. `lenet` is the published recipe, `lenet-with_bends` one of its variants.
    """
    found: dict[str, tuple[str, ...]] = dict.fromkeys(BASELINES, ())
    for path in sorted((conf_folder() / "experiment").glob("*.yaml")):
        found[path.stem] = (f"experiment={path.stem}",)
    for recipe in table_recipes():
        if not recipe.setting.startswith("published"):
            model, _, setting = recipe.name.partition("-")
            found[f"{NAMES.get(model, model)}-{setting}"] = recipe.overrides
    if weights:
        found["vgg"] += (f"model.weights={weights}",)
    else:
        del found["vgg"]
    return found


def chosen_entries(options: BoardOptions) -> dict[str, tuple[str, ...]]:
    """Return the entries that `only` names, in its order.

    Raises:
        InputError: it names an entry that does not exist.
    """
    known = entries(options.weights)
    if options.only is None:
        return known
    wanted = options.only.split(",")
    recipes = {name: name.partition("-")[0] for name in known}
    if unknown := set(wanted) - {*known, *recipes.values()}:
        raise InputError(
            f"only={options.only}: no entry {min(unknown)}; there are {', '.join(known)}"
        )
    return {name: known[name] for one in wanted for name in known if one in (name, recipes[name])}


def entry_folder(name: str, options: BoardOptions) -> Path:
    """Return the folder of an entry's trainings and results."""
    quick = options.quick and name not in BASELINES
    return RUNS / (f"{name}-quick" if quick else name)


def train_entry(
    name: str, overrides: tuple[str, ...], root: str, options: BoardOptions
) -> list[Path]:
    """Train the seeds that are missing, and return the checkpoints.

    Args:
        name: name of the entry.
        overrides: overrides of `drivezoo train`.
        root: folder of the recording `data=bench_v1`.
        options: options of the board.

    Raises:
        InputError: a training failed.
    """
    folders = [entry_folder(name, options) / str(seed) for seed in range(1, options.seeds + 1)]
    for folder in folders:
        if (folder / "metrics.json").is_file():
            continue
        # A recipe may have a `data.record` of its own, therefore the recording is named, too.
        words = [*overrides, f"data={DATA}", f"data.root={root}", "score=none"]
        words += [f"seed={folder.name}", *(["quick=true"] if options.quick else [])]
        if train_logged(folder, words, options.threads):
            raise InputError(f"{folder}: the training failed; see its log.txt")
        print(f"{folder}: trained", flush=True)
    return [folder / "checkpoints" / "best.ckpt" for folder in folders]


def drive_entry(name: str, drivers: list[str], options: BoardOptions) -> Path:
    """Drive the suite unless it is driven already, and return the folder of the result.

    Args:
        name: name of the entry.
        drivers: checkpoints, or the name of a baseline.
        options: options of the board.

    Raises:
        InputError: the drives failed.
    """
    suite = Path(options.suite).stem
    folder = entry_folder(name, options) / f"{suite}-{len(drivers)}"
    if (folder / "result.json").is_file():
        return folder
    words = ["zoo.benchmark", *drivers, f"suite={options.suite}", f"entry={folder.parent.name}"]
    words += [f"out={folder}", f"workers={options.threads}"]
    log = folder.parent / f"{folder.name}.txt"
    if run_logged(log, words, 1):
        raise InputError(f"{folder}: the benchmark failed; see {log}")
    print(f"{folder}: driven", flush=True)
    return folder


def recorded_root() -> str:
    """Return the folder of the recording `data=bench_v1`; record it if it does not exist.

    Raises:
        InputError: the recording was changed.
    """
    from zoo.training.embedded_recording import with_recording

    config = OmegaConf.create(compose_config([f"data={DATA}"]))
    return str(with_recording(config, Console(soft_wrap=True)).data.root)


def make_runs(options: BoardOptions) -> list[str]:
    """Train and drive what is missing, and add each driven entry to `docs/benchmark.csv`.

    A failed entry does not stop the others.

    Returns:
        The names of the entries that failed.

    Raises:
        InputError: `only` names no entry, or the recording was changed.
    """
    chosen = chosen_entries(options)
    root = recorded_root()
    failed = []
    for name, overrides in chosen.items():
        try:
            drivers = [name]
            if overrides:
                drivers = list(map(str, train_entry(name, overrides, root, options)))
            if not options.drive:
                continue
            folder = drive_entry(name, drivers, options)
            if options.suite == SUITE:
                add_entry(folder, name, *training_of(overrides, options))
        except InputError as error:
            print(error, file=sys.stderr, flush=True)
            failed.append(name)
    return failed


def training_of(overrides: tuple[str, ...], options: BoardOptions) -> tuple[str, str]:
    """Return an entry's column `training`, and the command of one training; empty for a baseline.

    >>> training_of(("experiment=lenet",), BoardOptions(quick=True))
    ('quick', 'drivezoo train experiment=lenet data=bench_v1 quick=true')
    """
    if not overrides:
        return "", ""
    quick = ["quick=true"] if options.quick else []
    command = shlex.join(["drivezoo", "train", *overrides, f"data={DATA}", *quick])
    return "quick" if options.quick else "whole", command


def add_entry(folder: Path, name: str, training: str, command: str) -> None:
    """Add a driven entry to `docs/benchmark.csv`.

    Raises:
        InputError: `result.json` is damaged, or a checkpoint was trained on other rows.
    """
    rows = csv_rows(folder, name, training, command)
    wanted = compose_config([f"data={DATA}"])["data"]["record"]["fingerprint"]
    if other := [row["data"] for row in rows if training and row["data"] != wanted]:
        raise InputError(
            f"{folder}: trained on rows with the fingerprint {other[0] or 'unknown'}, {DATA} has "
            f"{wanted}; train on data={DATA} alone"
        )
    write_csv(merge(rows))


def add_submitted(folder: Path) -> None:
    """Drive all drives of a submitted entry again, and add it if each digest is the same.

    Raises:
        InputError: a file is missing or damaged, or a drive differs.
    """
    from zoo.benchmark.checked_result import read_result

    result = read_result(folder)
    if result.suite != SUITE:
        raise InputError(f"{folder}: drove the suite {result.suite}; the board has only {SUITE}")
    for text in (result.entry, result.checkpoints[0].model):
        if not re.fullmatch(r"[\w.-]{1,60}", text):  # it stands in Markdown
            raise InputError(f"{folder}: {text[:60]!r}: name it with letters, digits, _, . and -")
    card, command = (folder / one for one in ("card.md", "command.txt"))
    for path in (card, command):
        if not path.is_file():
            raise InputError(f"{path}: does not exist; docs/benchmark.md says what it contains")
    verify = [sys.executable, "-m", "zoo.benchmark", "verify", str(folder), "drives=0"]
    if subprocess.run(verify, check=False).returncode:
        raise InputError(f"{folder}: not added, since the drives could not be verified")
    add_entry(folder, result.entry, "submitted", command.read_text().strip())


def main(arguments: list[str]) -> None:
    """Make the runs, then write the tables and the page.

    Raises:
        InputError: an option is wrong, or an entry failed or could not be verified.
    """
    options = read_options(BoardOptions, arguments)
    failed = []
    if options.add is not None:
        add_submitted(Path(options.add))
    elif options.runs:
        failed = make_runs(options)
    if options.suite == SUITE and options.drive:
        print(", ".join(map(str, [CSV, *write_pages(read_csv())])))
    if failed:
        raise InputError(f"failed: {', '.join(failed)}; the same command resumes")


if __name__ == "__main__":
    from zoo.cli.run_command import run_command

    sys.exit(run_command("board", main, sys.argv[1:]))
