"""The benchmark's board, rows and page, and the networks that come trained."""

import hashlib
import itertools
import re
import shlex
from pathlib import Path

from rich.console import Console

from benchmarks.measuring import Rows, grouped
from benchmarks.study_grid import Entry, Study, run_logged
from benchmarks.study_tables import CELLS, headline, of_group
from zoo.base.errors import InputError
from zoo.base.whole_file import json_text, write_whole
from zoo.cli.compose import compose_config
from zoo.runs.metrics_file import read_metrics_file

Row = dict[str, object]
SUITE = "v1"  # of the board
# The last epoch: no drive chooses it, and a score of the training does not change it.
CHECKPOINT = "last.ckpt"
FIGURES = ("autonomy", "m_per_intervention", "without_intervention", "cte_mean_m", "steering_per_s")
GROUPS = ("like", "sharp", "looks", "dynamics", "laps")  # of the board's roads


def board_rows(study: Study, entry: Entry) -> list[Row]:
    """Drive the suite with an entry's checkpoints; return its headline and a row for each group.

    Raises:
        InputError: the drives failed, or a checkpoint was trained on other rows.
    """
    drivers = [str(run / "checkpoints" / CHECKPOINT) for run in entry.finished] or [entry.name]
    suite = study.options.suite
    folder = entry.folder / f"{Path(suite).stem}-{len(drivers)}"
    if not (folder / "result.json").is_file():
        words = ["zoo.benchmark", *drivers, f"suite={suite}", f"entry={entry.folder.name}"]
        words += [f"out={folder}", f"workers={study.options.threads}"]
        run_logged(entry.folder / f"{folder.name}.txt", words, 1)
        print(f"{folder}: driven", flush=True)
    if suite != SUITE:
        return []
    if not entry.words:
        return rows_of_result(folder, entry.name, "", "")
    command = shlex.join(["drivezoo", "train", *study.command(entry)])
    training = "quick" if study.options.quick else "whole"
    return rows_of_result(folder, entry.name, training, command)


def rows_of_result(folder: Path, name: str, training: str, command: str) -> list[Row]:
    """Return the rows of an entry: its headline, then a row for each group.

    Args:
        folder: folder with the `result.json`.
        name: name of the entry.
        training: `whole`, `quick` or `submitted`; empty for a baseline.
        command: command that trains it, without the seed.

    Raises:
        InputError: `result.json` is damaged, or a checkpoint was trained on other rows.
    """
    from zoo.benchmark.checked_result import read_result

    result = read_result(folder)
    first = result.checkpoints[0]
    trained_on = " ".join(dict.fromkeys(driver.data for driver in result.checkpoints))
    wanted = compose_config(["data=bench_v1"])["data"]["record"]["fingerprint"]
    if training and trained_on != wanted:
        raise InputError(
            f"{folder}: trained on rows with the fingerprint {trained_on or 'unknown'}, bench_v1 "
            f"has {wanted}; train on data=bench_v1 alone"
        )
    entry = {
        "entry": name,
        "training": training,
        "network": first.model,
        "parameters": str(first.parameters),
        "training_seeds": str(len(result.checkpoints)),
        "suite": result.suite,
        "roads": result.roads,
        "data": trained_on,
        "code": str(result.code.get("hash")),
        "digest": result.digest,
        "command": command,
    }
    rows = []
    for group, figures in {"headline": {"autonomy": result.headline}, **result.groups}.items():
        roads = [drive for drive in result.drives if drive.group != "laps"]  # the headline's
        row = entry | {"group": group, "drives": str(len(result.of_group(group) or roads))}
        for figure, (bound, key) in itertools.product(
            FIGURES, (("", "value"), ("_low", "low"), ("_high", "high"))
        ):
            value = getattr(figures.get(figure), key, None)
            row[figure + bound] = "" if value is None else f"{value:.4f}"
        rows.append(row)
    return rows


def submitted_rows(folder: Path) -> list[Row]:
    """Drive all drives of a submitted entry again; return its rows if each digest is the same.

    Raises:
        InputError: a file is missing or damaged, or a drive differs.
    """
    from zoo.benchmark.checked_result import read_result, verify

    result = read_result(folder)
    if result.suite != SUITE:
        raise InputError(f"{folder}: drove the suite {result.suite}; the board has only {SUITE}")
    for text in (result.entry, result.checkpoints[0].model):
        if not re.fullmatch(r"[\w.-]{1,60}", text):  # it stands in Markdown
            raise InputError(f"{folder}: {text[:60]!r}: name it with letters, digits, _, . and -")
    for path in (folder / "card.md", folder / "command.txt"):
        if not path.is_file():
            raise InputError(f"{path}: does not exist; docs/benchmark.md says what it contains")
    verify(folder, SUITE, 0, 0, Console(emoji=False))
    command = (folder / "command.txt").read_text().strip()
    return rows_of_result(folder, result.entry, "submitted", command)


def board_page(rows: Rows, path: Path) -> None:
    """Write the board as one self-contained HTML page whose columns sort."""
    from zoo.leaderboard.ranking_page import PAGE

    # Heading, cell, and its arguments.
    cells = [(name, "text", f"{{{name}}}") for name in ("entry", "training", "network")]
    cells += [
        (name.replace("_", " "), "trained", name) for name in ("parameters", "training_seeds")
    ]
    cells += [(group, "percent", group, "autonomy") for group in ("headline", *GROUPS)]
    for group in GROUPS:
        for figure in FIGURES[1:]:
            cell = "percent" if figure == "without_intervention" else "number"
            cells.append((f"{group}: {figure}", cell, group, figure))
    entries = sorted(grouped(rows, ["entry", "training"]), key=lambda rows: -headline(rows))
    lines, scripted = [], []
    for entry in entries:
        line: list[tuple[str, float | None]] = []
        for _, cell, *given in cells:
            value = of_group(entry, *given)[0] if len(given) > 1 else entry[0].get(given[0])
            line.append((CELLS[cell](entry, *given), float(value) if value else None))
        lines.append(line)
        name = f"{entry[0]['entry']} {entry[0]['training']}"
        values = {row["group"]: float(row["autonomy"]) for row in entry if row["autonomy"]}
        scripted.append({"name": name, "values": values, "runs": []})
    axes = [
        {"key": group, "heading": group, "kind": "figure", "less": False, "share": True}
        for group in ("headline", *GROUPS)
    ]
    page = PAGE.render(
        title="drivezoo-bench v1",
        where="docs/benchmark.csv",
        lead="Autonomy by group of roads, with 95 % intervals over roads and training seeds. "
        "Click a heading to sort.",
        heads=[(heading, cell == "text") for heading, cell, *_ in cells],
        rows=lines,
        data={"axes": axes, "entries": scripted, "curves": []},
        unranked=[],
    )
    path.write_text(page)


def pretrained_rows(study: Study, entry: Entry) -> list[Row]:
    """Write the checkpoint and the facts of a network, and drive it; the facts are its rows.

    Raises:
        InputError: the drives failed.
    """
    from zoo.benchmark.checked_result import read_result
    from zoo.checkpoints.checkpoint import build_checkpoint, read_checkpoint_file
    from zoo.checkpoints.checkpoint_path import PACKAGED, packaged_names
    from zoo.checkpoints.new_checkpoint import checkpoint_bytes, lean_contents

    for run in entry.finished:
        metrics, path = read_metrics_file(run), run / "checkpoints" / "best.ckpt"
        contents = lean_contents(read_checkpoint_file(path))
        # From `data.record`, a further training records what this one was trained on.
        contents["drivezoo"]["config"]["data"]["root"] = None
        checkpoint, data = build_checkpoint(contents, path), checkpoint_bytes(contents)
        packaged = PACKAGED / f"{entry.name}.ckpt"
        write_whole(packaged, data)
        sha256, laps = hashlib.sha256(data).hexdigest(), study.config["laps"]
        folder, workers = entry.folder / sha256[:8], f"workers={study.options.threads}"
        evaluate = ["zoo.evaluate", str(packaged), "track=lake", f"seeds={laps}"]
        benchmark = ["zoo.benchmark", str(packaged), "suite=quick", f"entry={entry.name}"]
        for name, words in (("lake", evaluate), ("quick", benchmark)):
            if not list((folder / name).glob("*.json")):
                run_logged(folder / f"{name}.txt", [*words, workers, f"out={folder / name}"], 1)
        figures = read_metrics_file(folder / "lake")["tracks"]["lake"]
        result = read_result(folder / "quick")
        facts = {
            "network": type(checkpoint.network).__name__,
            "parameters": metrics["parameters"],
            "bytes": len(data),
            "sha256": sha256,
            "licence": "MIT",
            "command": shlex.join(["drivezoo", "train", *study.command(entry)]),
            "data": checkpoint.data,
            "code": metrics["code"],
            "versions": metrics["versions"],
            "drives": {
                "lake": {
                    "command": f"drivezoo evaluate {entry.name} track=lake seeds={laps}",
                    "drives": figures["drives"],
                    "kept": figures["drives_without_intervention"],
                    "autonomy": figures["autonomy"][0],
                    "cte_mean_m": figures["cte_mean_m"][0],
                },
                "unseen": {
                    "command": f"drivezoo benchmark {entry.name} suite=quick",
                    "drives": len(result.drives),
                    "kept": sum(not drive.figures["interventions"] for drive in result.drives),
                    "headline": result.headline.model_dump(),
                    "digest": result.digest,
                },
            },
        }
        write_whole(PACKAGED / f"{entry.name}.json", json_text(facts))
        packaged_names.cache_clear()
    return []
