"""The benchmark's board: its checkpoints and results."""

import itertools
import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from benchmarks.study_grid import Entry, Files, Study, run_logged, write_files
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint import read_checkpoint_file
from zoo.checkpoints.new_checkpoint import checkpoint_bytes, lean_contents
from zoo.results.checked_result import read_result, verify
from zoo.results.differences import RANKED, compare_pairs, in_order, possible_ranks, read_entries
from zoo.results.result import LEVEL_NEEDED, NAME, NEEDED, BenchmarkResult
from zoo.results.suite import OVERALL
from zoo.results.summary import LEVEL_FIGURES, drives_of

Row = dict[str, object]
BOARD, SUITE = Path("benchmarks/board"), "v3"  # a folder for each entry, as a submission has it
COMMAND = "command.txt"
CORRECT = "drivezoo correct "  # begins the command of an entry of the interactive track
INTERACTIVE = "interactive"
FIGURES = ("interventions_per_km", "without_intervention", "cte_mean_m", "steering_per_s")


def board_rows(study: Study, entry: Entry) -> list[Row]:
    """Drive the suite with an entry's checkpoints, and keep both for `rows_of_board`.

    Raises:
        InputError: the drives failed, or a checkpoint was trained on other rows.
    """
    checkpoints = [driven_checkpoint(entry, run) for run in entry.finished]
    folder = entry.folder / f"{SUITE}-{len(checkpoints)}"
    if not (folder / NAME).is_file():
        words = ["zoo.commands.benchmark", *map(str, checkpoints or [entry.name])]
        words += [f"suite={SUITE}", f"entry={entry.name}", f"out={folder}"]
        words.append(f"workers={study.options.threads}")
        run_logged(entry.folder / f"{folder.name}.txt", words, 1)
        print(f"{folder}: driven", flush=True)
    if not study.options.quick:
        words = ["drivezoo", "train", *study.command(entry)]
        if entry.corrects:
            words = [*CORRECT.split(), f"{entry.corrects}/SEED.ckpt", *entry.words]
        command = shlex.join(words) if entry.words else ""
        study.files |= kept_result(folder, command, checkpoints)
    return []


def driven_checkpoint(entry: Entry, run: Path) -> Path:
    """Write what drives of a run, and is committed: its card, and its weights in 16 bits."""
    path = entry.folder / f"{run.name}.ckpt"
    contents = lean_contents(read_checkpoint_file(entry.checkpoint(run)))
    contents["state_dict"] = {
        name: tensor.half() if tensor.is_floating_point() else tensor
        for name, tensor in contents["state_dict"].items()
    }
    return write_whole(path, checkpoint_bytes(contents))


def kept_result(folder: Path, command: str, checkpoints: Sequence[Path]) -> Files:
    """Return the board's files of an entry, with few figures of each drive.

    Args:
        folder: folder with the `result.json`.
        command: command that trains the entry, without the seed; empty for a baseline.
        checkpoints: files that drove.

    Raises:
        InputError: `result.json` is damaged, or a checkpoint was trained on other rows.
    """
    result = read_result(folder)
    trained_on = " ".join(dict.fromkeys(driver.data for driver in result.checkpoints))
    wanted = compose_config(["data=bench_v1"])["data"]["record"]["fingerprint"]
    if command and not command.startswith(CORRECT) and trained_on != wanted:
        raise InputError(
            f"{folder}: trained on rows with the fingerprint {trained_on or 'unknown'}, bench_v1 "
            f"has {wanted}; train on data=bench_v1 alone"
        )
    board = BOARD / result.entry
    names = [*NEEDED, *LEVEL_NEEDED]
    drives = [
        drive.model_copy(update={"figures": {name: drive.figures[name] for name in names}})
        for drive in result.drives
    ]
    # Where a folder is on a machine is nobody's business.
    drivers = [
        driver.model_copy(update={"file": Path(driver.file).name}) for driver in result.checkpoints
    ]
    lines = ",\n".join(drive.model_dump_json() for drive in drives)  # a line for each drive
    kept = result.model_copy(update={"drives": [], "checkpoints": drivers})
    text = kept.model_dump_json().replace('"drives":[]', f'"drives":[\n{lines}\n]', 1)
    files: Files = {board / COMMAND: f"{command}\n"} if command else {}
    files |= {board / path.name: path.read_bytes() for path in checkpoints}
    return files | {board / NAME: f"{text}\n"}


def rows_of_board() -> list[Row]:
    """Return a row for each entry of the board and group of roads, the ranked entries first.

    Their order is that of `in_order`. A rank is an interval: entries whose score is not told apart
    from its own, corrected for the number of pairs (Holm), may be above. An entry that an expert
    corrected is `interactive` and has no rank.

    Raises:
        InputError: a result is damaged, or results were driven by several versions of the code.
    """
    folders = [path.parent for path in sorted(BOARD.glob(f"*/{NAME}"))]
    by_kind = [
        (INTERACTIVE if command_of(entry.result).startswith(CORRECT) else entry.kind, entry)
        for entry in in_order(read_entries(*folders))
    ]
    codes = {entry.result.code.get("hash"): entry.result.entry for _, entry in by_kind}
    if len(codes) > 1:
        raise InputError(
            f"{BOARD}: {' and '.join(codes.values())} were driven by different code; drive all "
            "entries by one commit"
        )
    by_kind.sort(key=lambda pair: pair[0] != RANKED)
    ranked = [entry for kind, entry in by_kind if kind == RANKED]
    ranks = possible_ranks(compare_pairs(ranked), len(ranked))
    return [
        {"rank": rank, "kind": kind, **row}
        for (kind, entry), rank in itertools.zip_longest(by_kind, ranks, fillvalue="")
        for row in rows_of_result(entry.result)
    ]


def command_of(result: BenchmarkResult) -> str:
    """Return the command that trains an entry of a board; empty for a baseline."""
    path = BOARD / result.entry / COMMAND
    return path.read_text().strip() if path.is_file() else ""


def rows_of_result(result: BenchmarkResult) -> list[Row]:
    """Return the rows of an entry, one for each axis, the first for all."""
    first = result.checkpoints[0]
    entry = {
        "entry": result.entry,
        "network": first.model,
        "parameters": str(first.parameters) if first.sha256 else "",
        "training_seeds": str(len(result.checkpoints)) if first.sha256 else "",
        "suite": result.suite,
        "roads": result.roads,
        "data": first.data,
        "code": str(result.code.get("hash")),
        "digest": result.digest,
        "command": command_of(result),
    }
    rows = []
    names = [*FIGURES, *(figure for figure in LEVEL_FIGURES if figure in result.groups[OVERALL])]
    for group in dict.fromkeys([OVERALL, *result.groups]):
        row = entry | {"group": group, "drives": str(len(drives_of(result.drives, group)))}
        figures = {name: figure.model_dump() for name, figure in result.groups[group].items()}
        for figure, (end, key) in itertools.product(
            names, (("", "value"), ("_low", "low"), ("_high", "high"))
        ):
            value = figures[figure][key]
            row[figure + end] = "" if value is None else f"{value:.4f}"
        rows.append(row)
    return rows


def add_submission(folder: Path) -> None:
    """Drive all drives of a submitted entry again; add it to the board if all are the same.

    Raises:
        InputError: a file is missing or damaged, or a drive differs.
    """
    result = read_result(folder)
    if result.suite != SUITE:
        raise InputError(f"{folder}: drove the suite {result.suite}; the board is of {SUITE}")
    for text in (result.entry, result.checkpoints[0].model):
        if not re.fullmatch(r"\w[\w.-]{0,59}", text):  # it stands in Markdown, and names a folder
            raise InputError(f"{folder}: {text[:60]!r}: name it with letters, digits, _, . and -")
    checkpoints = [folder / Path(driver.file).name for driver in result.checkpoints]
    for path in (folder / "card.md", folder / COMMAND, *checkpoints):
        if not path.is_file():
            raise InputError(f"{path}: does not exist; docs/benchmark.md says what it contains")
    verify(folder, result.suite, 0, 0, Console(emoji=False))
    write_files(kept_result(folder, (folder / COMMAND).read_text().strip(), checkpoints))
