"""The benchmark's board, its results and page."""

import itertools
import os
import re
import shlex
from pathlib import Path

from rich.console import Console

from benchmarks.measuring import Rows, grouped
from benchmarks.study_grid import PACKAGED, Entry, Files, Study, run_logged, write_files
from benchmarks.study_tables import CELLS, of_group
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.results.result import DIGESTS, LEVEL_NEEDED, NAME, NEEDED, BenchmarkResult
from zoo.results.suite import OVERALL

Row = dict[str, object]
# By suite: a folder for each entry, as a submission has it.
BOARDS = {"v1": Path("benchmarks/board"), "v2": Path("benchmarks/board_v2")}
COMMAND = "command.txt"
CORRECT = "drivezoo correct "  # begins the command of an entry of the interactive track
INTERACTIVE, HALF = "interactive", "bfloat16"
FIGURES = (
    "interventions_per_km",
    "without_intervention",
    "shortfall",
    "cte_mean_m",
    "steering_per_s",
)
GROUPS = (OVERALL, "like", "sharp", "looks", "dynamics", "laps")  # of v1


def board_rows(study: Study, entry: Entry) -> list[Row]:
    """Drive the suite with an entry's checkpoints, and keep the result for `rows_of_board`.

    Raises:
        InputError: the drives failed, or a checkpoint was trained on other rows.
    """
    drivers = [str(entry.checkpoint(run)) for run in entry.finished]
    drivers = drivers or [entry.name.removeprefix(PACKAGED)]
    suite = study.options.suite
    folder = entry.folder / f"{Path(suite).stem}-{len(drivers)}"
    if not (folder / NAME).is_file():
        words = ["zoo.commands.benchmark", *drivers, f"suite={suite}", f"entry={entry.folder.name}"]
        words += [f"out={folder}", f"workers={study.options.threads}"]
        run_logged(entry.folder / f"{folder.name}.txt", words, 1)
        print(f"{folder}: driven", flush=True)
    if suite == study.config["board"] and not study.options.quick:
        words = ["drivezoo", "train", *study.command(entry)]
        if entry.corrects:
            words = [*CORRECT.split(), "CKPT", *entry.words]
        study.files |= kept_result(folder, shlex.join(words) if entry.words else "")
    return []


def kept_result(folder: Path, command: str) -> Files:
    """Return the files of the board's results for a folder, with few figures of each drive.

    Args:
        folder: folder with the `result.json`.
        command: command that trains the entry, without the seed; empty for a baseline.

    Raises:
        InputError: `result.json` is damaged, or a checkpoint was trained on other rows.
    """
    from zoo.checkpoints.checkpoint_path import packaged_name
    from zoo.results.checked_result import read_result

    result = read_result(folder)
    trained_on = " ".join(dict.fromkeys(driver.data for driver in result.checkpoints))
    wanted = compose_config(["data=bench_v1"])["data"]["record"]["fingerprint"]
    interactive = result.has_levels and command.startswith(CORRECT)
    if command and not interactive and trained_on != wanted:
        raise InputError(
            f"{folder}: trained on rows with the fingerprint {trained_on or 'unknown'}, bench_v1 "
            f"has {wanted}; train on data=bench_v1 alone"
        )
    board = BOARDS[result.suite] / result.entry
    names = [*NEEDED, *(LEVEL_NEEDED if result.has_levels else ())]
    drives = [
        drive.model_copy(update={"figures": {name: drive.figures[name] for name in names}})
        for drive in result.drives
    ]
    # Where a packaged network, or this folder, is on a machine is nobody's business.
    here = f"{Path.cwd()}{os.sep}"
    checkpoints = [
        checkpoint.model_copy(
            update={
                "file": packaged_name(Path(checkpoint.file)) or checkpoint.file.removeprefix(here)
            }
        )
        for checkpoint in result.checkpoints
    ]
    lines = ",\n".join(drive.model_dump_json() for drive in drives)  # a line for each drive
    keys = set(BenchmarkResult.model_fields)
    kept = result.model_copy(update={"drives": [], "checkpoints": checkpoints})
    text = kept.model_dump_json(include=keys)
    text = text.replace('"drives":[]', f'"drives":[\n{lines}\n]', 1)
    files: Files = {board / COMMAND: f"{command}\n"} if command else {}
    return files | {board / NAME: f"{text}\n"}


def rows_of_board(suite: str = "v1") -> list[Row]:
    """Return a row for each entry of a board and group of roads, the ranked entries first.

    Their order is that of `in_order`. A rank is an interval: entries whose score is not told apart
    from its own, corrected for the number of pairs (Holm), may be above. An entry that an expert
    corrected is `interactive`, one that was trained in bfloat16 beside its partner in 32 bits is
    `bfloat16`; these have no rank.

    Raises:
        InputError: a result is damaged, or results were driven by several versions of the code.
    """
    from zoo.results import differences as of

    folders = [path.parent for path in sorted(BOARDS[suite].glob(f"*/{NAME}"))]
    by_kind = [
        (_track_of(command_of(entry.result)) or entry.kind, entry)
        for entry in of.in_order(of.read_entries(*folders))
    ]
    results = [entry.result for _, entry in by_kind]
    # Those of older digests were driven by several versions, as their pages say.
    codes = {
        result.code.get("hash"): result.entry for result in results if result.digests == DIGESTS
    }
    if len(codes) > 1:
        raise InputError(
            f"{BOARDS[suite]}: {' and '.join(codes.values())} were driven by different code; drive "
            "all entries by one commit"
        )
    by_kind.sort(key=lambda pair: pair[0] != of.RANKED)
    ranked = [entry for kind, entry in by_kind if kind == of.RANKED]
    ranks = of.possible_ranks(of.compare_pairs(ranked), len(ranked))
    return [
        {"rank": rank, "kind": kind, **row}
        for (kind, entry), rank in itertools.zip_longest(by_kind, ranks, fillvalue="")
        for row in rows_of_result(entry.result)
    ]


def _track_of(command: str) -> str | None:
    """Return the kind of an entry that its command alone shows."""
    if command.startswith(CORRECT):
        return INTERACTIVE
    return HALF if "trainer.precision=bf16" in command else None


def command_of(result: BenchmarkResult) -> str:
    """Return the command that trains an entry of a board; empty for a baseline."""
    path = BOARDS[result.suite] / result.entry / COMMAND
    return path.read_text().strip() if path.is_file() else ""


def rows_of_result(result: BenchmarkResult) -> list[Row]:
    """Return the rows of an entry, one for each group, the first for all but the laps."""
    from zoo.results.summary import LEVEL_FIGURES, drives_of

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
        less = {
            key: None if part is None else 1 - part for key, part in figures["autonomy"].items()
        }
        figures["shortfall"] = less | {"low": less["high"], "high": less["low"]}
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
    from zoo.results.checked_result import read_result, verify

    result = read_result(folder)
    if result.suite not in BOARDS:
        suites = " and ".join(BOARDS)
        raise InputError(f"{folder}: drove the suite {result.suite}; there are boards for {suites}")
    for text in (result.entry, result.checkpoints[0].model):
        if not re.fullmatch(r"\w[\w.-]{0,59}", text):  # it stands in Markdown, and names a folder
            raise InputError(f"{folder}: {text[:60]!r}: name it with letters, digits, _, . and -")
    for path in (folder / "card.md", folder / COMMAND):
        if not path.is_file():
            raise InputError(f"{path}: does not exist; docs/benchmark.md says what it contains")
    verify(folder, result.suite, 0, 0, Console(emoji=False))
    write_files(kept_result(folder, (folder / COMMAND).read_text().strip()))


def board_page(rows: Rows, path: Path) -> None:
    """Write the board as one self-contained HTML page whose columns sort."""
    from zoo.results.ranking_page import PAGE
    from zoo.runs.result_table import Table

    # Heading, cell, and its arguments.
    first, *others = FIGURES
    cells = [
        *((name, "text", f"{{{name}}}") for name in ("rank", "entry")),
        *((group, "number", group, first) for group in GROUPS),
        ("network", "text", "{network}"),
        *((name.replace("_", " "), "trained", name) for name in ("parameters", "training_seeds")),
    ]
    lines, scripted = [], []
    for entry in grouped(rows, ["entry"]):
        line: list[tuple[str, float | None]] = []
        for _, cell, *keys in cells:
            value = of_group(entry, *keys)[0] if len(keys) > 1 else entry[0].get(keys[0])
            line.append((CELLS[cell](entry, *keys), float(value) if value else None))
        lines.append(line)
        values = {row["group"]: float(row["interventions_per_km"]) for row in entry}
        scripted.append({"name": entry[0]["entry"], "values": values, "runs": []})
    tables = []
    for figure in others:
        cell = CELLS["percent" if figure in ("without_intervention", "shortfall") else "number"]
        texts = [
            [entry[0]["entry"], *(cell(entry, group, figure) for group in GROUPS)]
            for entry in grouped(rows, ["entry"])
        ]
        title = figure.replace("_", " ").replace("cte mean m", "mean cross-track error, m")
        tables.append((title, Table.of(["entry", *GROUPS], texts)))
    axes = [
        {"key": group, "heading": group, "kind": "figure", "less": True, "share": False}
        for group in GROUPS
    ]
    page = PAGE.render(
        title="drivezoo-bench v1",
        where="docs/benchmark.csv",
        lead="Interventions per km by group of roads. Small: 95 % intervals for new roads of the "
        "families and new trainings. Click a heading to sort.",
        heads=[(heading, cell == "text") for heading, cell, *_ in cells],
        rows=lines,
        more=tables,
        data={"axes": axes, "entries": scripted, "curves": []},
        unranked=[],
    )
    path.write_text(page)
