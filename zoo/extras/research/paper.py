"""`drivezoo leaderboard paper=FOLDER`: tables, plots, an appendix and an archive for a paper.

Results of the benchmark have drives on many roads, so that pairs of entries can be compared. Runs
have drives on their own few tracks: for them there are neither pairs nor profiles.
"""

import io
import re
import zipfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from zoo.base.bounded_files import hash_file, read_regular
from zoo.base.errors import InputError
from zoo.base.file_text import markdown_code, markdown_text
from zoo.base.new_folder import command_folder
from zoo.base.output_files import check_output
from zoo.base.terminal import command_line
from zoo.base.whole_file import write_output
from zoo.checkpoints.checkpoint_path import FOLDER, on_server
from zoo.driving.clustered import SHARE, clustered
from zoo.driving.intervals import Estimate
from zoo.extras.research.share_panels import share_panels
from zoo.results import differences
from zoo.results import ranking as of
from zoo.results.benchmarked import INTERVALS, SHORT, figure_columns
from zoo.results.checked_result import files_beside
from zoo.results.differences import Comparison, Entry
from zoo.results.marks import verify_words
from zoo.results.ranking_page import Ranking
from zoo.results.result import NAME, SCORES, code_name
from zoo.results.scored import BENCHMARK
from zoo.results.suite import DEV, Road, find_suite, suite_names
from zoo.results.summary import FIGURES, complement, overall
from zoo.runs.code_fingerprint import code_fingerprint, package_versions
from zoo.runs.plots import interval_panels
from zoo.runs.result_table import Cell, Column, Table, interval_column, number_column
from zoo.runs.run_record import Run
from zoo.runs.table_files import write_plot, write_table

ARCHIVE, APPENDIX, COMMAND = "repeat.zip", "appendix.md", "command.txt"
NOT_ALWAYS = ("pairs.tex", "pairs.csv", "profiles.pdf")  # files that not every paper has
OF_RUN = (
    *(".hydra/config.yaml", ".hydra/overrides.yaml", ".hydra/hydra.yaml"),
    *("metrics.json", "metrics.csv", "split.csv", "status.json"),
)
MOST_CHECKPOINT_BYTES, MOST_BYTES = 5_000_000, 100_000_000  # of a file in the archive
THRESHOLDS = 100  # of a profile
RANKS = (
    "Rank: an entry above counts as better with p < 0.05 on the same roads, corrected for the "
    "number of pairs (Holm); entries of one training and baselines have none. In brackets: "
)
PAIRS = (
    "A minus B on the same roads, all but the laps. In brackets: 95 % interval over roads and "
    "training seeds, of each pair alone. p: of the difference, corrected for the number of pairs "
    "(Holm)."
)


@dataclass
class Paper:
    """What `write_paper` writes.

    Attributes:
        tables: tables by the names of their files.
        plots: figures by the names of their files.
        commands: by entry, the commands that made it.
        rows: a row of facts for each training or checkpoint.
        versions: versions of packages of each training.
        files: contents by name in the archive.
        repeats: commands that repeat what the archive has.
        notes: what could not be written.
    """

    tables: dict[str, Table] = field(default_factory=dict)
    plots: dict[str, Figure] = field(default_factory=dict)
    commands: dict[str, list[str]] = field(default_factory=dict)
    rows: list[dict[str, Cell]] = field(default_factory=list)
    versions: list[Mapping[str, str]] = field(default_factory=list)
    files: dict[str, bytes] = field(default_factory=dict)
    repeats: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add_file(self, name: str, path: Path, most_bytes: int = MOST_BYTES) -> None:
        """Add a file to the archive, unless it is too large, or is or lies in a stranger's link."""
        links = [path, *path.parents][: len(Path(name).parts) - 2]  # below the run or the result
        if not path.is_file() or any(map(Path.is_symlink, links)):
            return
        if (size := path.stat().st_size) > most_bytes:
            self.notes.append(f"not in {ARCHIVE}: {path} ({size / 1e6:.1f} MB)")
        else:
            self.files[name] = read_regular(path, most_bytes)

    def add_run(self, name: str, run: Run) -> str:
        """Add the files of a training; return its command."""
        for file in OF_RUN:
            self.add_file(f"runs/{name}/{file}", run.folder / file)
        self.repeats.append(f"drivezoo rerun runs/{name}")
        self.versions.append(run.metrics.get("versions") or {})
        return command_line(["drivezoo", "train", *run.overrides])


def write_paper(ranking: Ranking, out: str | Path, command: str) -> tuple[list[Path], list[str]]:
    """Write the files of a paper into a new folder, or with `overwrite=true` over an earlier one.

    Args:
        ranking: ranked results of the benchmark, or ranked runs.
        out: folder to create, or of an earlier paper.
        command: command that writes the files, for the appendix.

    Returns:
        Paths of the files, and lines that say what is missing.

    Raises:
        InputError: nothing is ranked, runs are mixed with other results, results are of different
            roads, a file cannot be read, or the folder is no new one.
    """
    scored = [run for entry in ranking.entries for run in entry.runs]
    results = [run.folder for run in scored if run.source == BENCHMARK]
    if not scored or len(scored) not in (len(results), sum(bool(run.settings) for run in scored)):
        raise InputError(
            f"paper={out}: needs results of drivezoo benchmark alone, or finished trainings alone; "
            "name their folders"
        )
    with command_folder(out, "papers", resumed_by=APPENDIX, key="paper=") as folder:
        check_output(folder / APPENDIX, "paper")
        paper = of_results(differences.read_entries(*results)) if results else of_runs(ranking)
        if not paper.files:
            raise InputError(
                f"paper={out}: each result is a link, which {ARCHIVE} does not follow; copy the "
                "files in place of the links"
            )
        paper.plots["intervals"].supxlabel("bar: 95 % interval", fontsize="medium")
        for name in NOT_ALWAYS:  # of an earlier paper
            (folder / name).unlink(missing_ok=True)
        text = _appendix(paper, command, [*paper.notes, *ranking.unranked_lines()])
        written = [
            write_table(table, folder / f"{name}{ending}")
            for name, table in paper.tables.items()
            for ending in (".tex", ".csv")
        ]
        written += [write_plot(plot, folder / f"{name}.pdf") for name, plot in paper.plots.items()]
        written.append(write_output(folder / APPENDIX, text))
        files = {APPENDIX: text.encode(), **paper.files}
        written.append(write_output(folder / ARCHIVE, _archive(files)))
    return written, paper.notes


def of_results(entries: Sequence[Entry]) -> Paper:
    """Return the paper of results of the benchmark on the same roads."""
    entries, paper = differences.in_order(entries), Paper()
    counts = Counter(entry.result.entry for entry in entries)
    names = [
        name if counts[name := row.result.entry] == 1 else f"{name} ({row.path})" for row in entries
    ]
    ranked = [entry for entry in entries if entry.kind == differences.RANKED]
    pairs = differences.compare_pairs(ranked)
    ranks = differences.possible_ranks(pairs, len(ranked)) + ["-"] * (len(entries) - len(ranked))
    paper.tables["table"] = _entries_table(entries, names, ranks)
    if pairs:
        paper.tables["pairs"] = _pairs_table(names, pairs, entries[0].result.score)
    else:
        paper.notes.append("no pairs: fewer than two entries of several training seeds")
    figures = [overall(entry.result) for entry in entries]
    panels = {}
    for key in SHORT:
        intervals = dict(zip(names, (figure[key] for figure in figures), strict=True))
        panels[FIGURES[key].heading] = intervals, FIGURES[key].factor
    paper.plots["intervals"] = interval_panels(panels)
    drawn = _levels if entries[0].result.has_levels else _thresholds
    paper.plots["profiles"] = drawn(dict(zip(names, entries, strict=True)))
    for number, (name, entry) in enumerate(zip(names, entries, strict=True), 1):
        plain = re.sub(r"[^\w.-]", "_", entry.result.entry)[:60]
        _add_entry(paper, name, f"{number}_{plain}", entry)
    return paper


def of_runs(ranking: Ranking) -> Paper:
    """Return the paper of trainings with the drives that scored them."""
    entries, paper = ranking.entries, Paper({"table": ranking.result_table()})
    columns = of.setting_columns(entries)
    cells = of.in_one_column(columns).cells if columns else []
    names = [cell.replace("\n", ", ") for cell in cells]
    if len(set(names)) < len(entries):
        names = [of.run_name(entry, ranking.under) for entry in entries]
    figures = of.ranked_figures(entries)
    keys = of.short_figures(figures)
    short = [figure for figure in figures if figure.form and figure.key in keys]
    panels = {}
    for figure in short:
        intervals = dict(zip(names, map(figure.interval, entries), strict=True))
        panels[figure.heading] = intervals, 100 if "%" in figure.form else 1
    paper.plots["intervals"] = interval_panels(panels)
    paper.notes.append(
        "no pairs and no profiles: trainings are scored on few tracks, which say nothing about "
        "other roads; for these, drive each entry on the roads of a suite:"
    )
    for index, (name, entry) in enumerate(zip(names, entries, strict=True), 1):
        commands = paper.commands.setdefault(name, [])
        for number, scored in enumerate(entry.runs, 1):
            run, label = Run(scored.folder), f"{index}-{number}"
            commands.append(paper.add_run(label, run))
            if run.checkpoint_path:
                inside = f"runs/{label}/{FOLDER}/{run.checkpoint_path.name}"
                paper.add_file(inside, run.checkpoint_path, MOST_CHECKPOINT_BYTES)
            code = code_name(run.metrics.get("code") or {})
            facts = {"seed": scored.seed, "data": scored.trained_on.name, "code": code}
            paper.rows.append({"entry": name, "run": label, **facts})
        words = [*(str(run.folder) for run in entry.runs), f"out=marks/{index}"]
        paper.notes.append(command_line(["drivezoo", "benchmark", *words, f"entry=entry_{index}"]))
    paper.notes.append("drivezoo leaderboard marks paper=FOLDER")
    return paper


def _entries_table(entries: Sequence[Entry], names: Sequence[str], ranks: Sequence[str]) -> Table:
    results = [entry.result for entry in entries]
    counts: dict[str, list[int | None]] = {
        "parameters": [entry.result.checkpoints[0].parameters for entry in entries],
        "seeds": [entry.seeds or None for entry in entries],
        "drives": [(entry.seeds or 1) * len(entry.roads) for entry in entries],
    }
    first = results[0].score if results[0].has_levels else SHORT[0]  # that of the order
    figures = figure_columns([overall(result) for result in results])
    columns = [
        Column("rank", "rank", ranks),
        Column("entry", "entry", names),
        *(
            number_column(name, name, numbers, "{:,}", short=name != "drives")
            for name, numbers in counts.items()
        ),
        *sorted(figures, key=lambda column: column.name != first),
    ]
    for group in dict.fromkeys(road.group for road in entries[0].drives):
        columns += figure_columns([result.groups[group] for result in results], group)
    suite = f"Drives of the suite {results[0].suite}, all roads but the laps. "
    return Table(columns, f"{suite}{RANKS}{INTERVALS}")


def _pairs_table(
    names: Sequence[str], pairs: Mapping[tuple[int, int], Comparison], score: str
) -> Table:
    rows = list(pairs.values())
    points, shares = [row.difference for row in rows], [row.a_better for row in rows]
    return Table(
        [
            Column("a", "A", [names[a] for a, _ in pairs]),
            Column("b", "B", [names[b] for _, b in pairs]),
            interval_column(score, f"{SCORES[score]}, points", points, "{:+.1f}", 100),
            interval_column("a_better", "A better, %", shares, "{:.0f}", 100),
            number_column("p", "p", [row.p for row in rows], "{:.3f}"),
            Column("verdict", "verdict", [row.verdict for row in rows]),
        ],
        PAIRS,
    )


def _thresholds(entries: Mapping[str, Entry]) -> Figure:
    """Draw the share of drives with an autonomy above thresholds from 0 on.

    Source: Agarwal et al. 2021, arXiv:2108.13264, performance profiles.
    """
    thresholds, curves = np.linspace(0, 1, THRESHOLDS, endpoint=False), {}
    for name, entry in entries.items():
        roads, scores = entry.roads, entry.scores(entry.roads)
        curves[name] = [_share(scores > threshold, roads) for threshold in thresholds]
    panels = {"": ((100 * thresholds).tolist(), curves)}
    return share_panels(panels, "autonomy \u03c4 (%)", "drives above \u03c4 (%)")


def _levels(entries: Mapping[str, Entry]) -> Figure:
    """Draw the share of clean drives of each level of each axis."""
    axes: dict[str, dict[int, list[Road]]] = {}
    for road, drives in next(iter(entries.values())).drives.items():
        if drives[0].level:
            axes.setdefault(road.group, {}).setdefault(drives[0].level, []).append(road)
    panels = {}
    for axis, levels in axes.items():
        numbers = sorted(levels)
        curves = {
            name: [_share(entry.scores(levels[number]) > 0, levels[number]) for number in numbers]
            for name, entry in entries.items()
        }
        panels[axis] = numbers, curves
    return share_panels(panels, "level", "clean drives (%)")


def _share(kept: np.ndarray, roads: list[Road]) -> Estimate:
    """Return the share of drives, bool [training seeds, roads], with its interval."""
    places, groups = differences.clusters(roads)
    # Of the others, since the exact bound is that of no failure at all.
    lost = clustered(1.0 - kept, places=places, groups=groups, limits=SHARE, one_failure=1.0)
    return complement(lost)


def _add_entry(paper: Paper, name: str, position: str, entry: Entry) -> None:
    """Add the commands, facts and files of a result."""
    result, commands = entry.result, paper.commands.setdefault(name, [])
    checkpoints, missing = [], []
    inside, folder = f"results/{position}", entry.path if entry.path.is_dir() else entry.path.parent
    for file in (NAME, COMMAND):
        paper.add_file(f"{inside}/{file}", folder / file)
    for number, driver in enumerate(result.checkpoints, 1):
        digits = (driver.sha256 or "")[:16]
        places = files_beside(driver, folder) + [Path(driver.file)] * (not on_server(driver.file))
        files = (path for path in places if path.is_file() and hash_file(path) == driver.sha256)
        path = next(files, None)
        checkpoints.append(str(path or driver.file))
        if path:
            # So named, `drivezoo benchmark verify` finds it.
            paper.add_file(f"{inside}/{digits}{path.suffix}", path, MOST_CHECKPOINT_BYTES)
        elif digits:
            missing.append(driver.file)
        if path and (run := Run(path.parent.parent)).folder.joinpath(OF_RUN[0]).is_file():
            commands.append(paper.add_run(f"{position}-{number}", run))
        elif digits and (text := paper.files.get(f"{inside}/{COMMAND}")):
            seed = "" if driver.training_seed is None else f" seed={driver.training_seed}"
            commands.append(text.decode(errors="replace").strip() + seed)
        facts = {"network": driver.model, "checkpoint": digits or None, "data": driver.data or None}
        facts |= {"code": code_name(result.code), "drives": result.digest}
        paper.rows.append({"entry": name, "seed": driver.training_seed, **facts})
    try:
        suite, split = find_suite(result.suite, suite_names()[0])
    except InputError:
        own = result.suite.removesuffix(f"-{DEV}")
        suite, split = f"{own}.yaml", "test" if own == result.suite else DEV
        line = f"not in {ARCHIVE}: the file of your suite {result.suite}; publish it, too"
        paper.notes += [line] if line not in paper.notes else []
    words = ["drivezoo", "benchmark", *checkpoints, f"suite={suite}"]
    words += [f"split={DEV}"] if split == DEV else []
    commands.append(command_line([*words, f"entry={result.entry}"]))
    if missing:
        line = f"not in {ARCHIVE}, since no such file of {name} is there: {', '.join(missing)}"
        paper.notes.append(line)
    else:
        paper.repeats.append(command_line(["drivezoo", *verify_words(Path(inside), suite)]))


def _appendix(paper: Paper, command: str, missing: Sequence[str]) -> str:
    """Return the appendix as Markdown: commands, fingerprints, versions and what is missing."""
    versions = []
    for name, number in package_versions().items():
        trained = sorted({str(version.get(name, "-")) for version in paper.versions})
        versions.append([name, number, ", ".join(trained) or "-"])
    lines = ["# How the figures were made", "", markdown_code(command)]
    lines += [f"Written by the code {code_name(code_fingerprint())}."]
    for name, table in paper.tables.items():
        lines += ["", f"`{name}`: {markdown_text(table.caption)}"]
    lines += ["", "## Commands"]
    for name, commands in paper.commands.items():
        lines += ["", f"{markdown_text(name)}:", "", markdown_code("\n".join(commands))]
    lines += ["", "## Fingerprints", "", Table.of_figures(paper.rows).markdown(left=99), ""]
    lines += ["## Versions", ""]
    lines += [Table.of(["package", "here", "of the trainings"], versions).markdown(left=3), ""]
    gaps = markdown_code("\n".join(missing)) if missing else "Nothing."
    lines += ["## What is missing", "", gaps]
    lines += ["", "## Repeat it", "", f"Unpack {ARCHIVE}, and type there:", ""]
    again = [f"drivezoo leaderboard {next(iter(paper.files)).split('/')[0]} paper=again"]
    return "\n".join([*lines, markdown_code("\n".join([*again, *paper.repeats])), ""])


def _archive(files: Mapping[str, bytes]) -> bytes:
    """Return a ZIP file; the same contents give the same bytes."""
    contents = io.BytesIO()
    with zipfile.ZipFile(contents, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in sorted(files.items()):
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
    return contents.getvalue()
