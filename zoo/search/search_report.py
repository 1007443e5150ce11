"""A search from its options to its files: search.json, map.png and mildest.yaml."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import yaml
from rich.console import Console

from zoo.base.errors import InputError
from zoo.base.new_folder import command_folder
from zoo.base.whole_file import json_text, write_whole
from zoo.checkpoints.checkpoint_path import short_name
from zoo.checkpoints.policy import load_policy
from zoo.cli.closing_lines import print_written
from zoo.cli.console_progress import progress_bar
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.plots import save_figure
from zoo.runs.table import Column, Table
from zoo.runs.table_files import check_table, write_table
from zoo.search.failure_map import Archive, failure_map
from zoo.search.search_options import SearchOptions
from zoo.search.search_run import (
    Driven,
    distance_to_usual,
    opened_driver,
    search,
    usual_features,
)
from zoo.search.search_space import SearchSpace, weather_text
from zoo.worlds.embedded_world import ROAD

VERSION = 1
RESULT, MAP, MILDEST = "search.json", "map.png", f"{ROAD}.yaml"


@dataclass(frozen=True)
class Report:
    """What the files of a search are written from.

    Attributes:
        checkpoint: checkpoint file.
        sha256: hash of the checkpoint file.
        options: options of the search.
        space: roads and days.
        archive: cells of the map.
        usual: the family's usual value of each feature.
        folder: folder to write to.
    """

    checkpoint: str
    sha256: str
    options: SearchOptions
    space: SearchSpace
    archive: Archive
    usual: dict[str, float]
    folder: Path

    def distance(self, one: Driven) -> float:
        """Return how far a road is from the family's usual one; see `distance_to_usual`."""
        return distance_to_usual(one.candidate.features, self.usual, self.space)

    def mildest(self, drives: list[Driven]) -> Driven | None:
        """Return the failure that is nearest to the family's usual road; None without one."""
        return min((one for one in drives if one.outcome.failed), key=self.distance, default=None)

    def replay(self, one: Driven) -> list[str]:
        """Return the words after `drivezoo` that drive a road again, as the mildest."""
        options = self.options
        changed = [f"weather={weather_text(one.candidate.weather)}"]
        changed += [f"speed={options.speed:g}"] if options.speed != 15 else []
        changed += [f"frame_rate={options.frame_rate!r}"] if options.frame_rate != 15 else []
        changed += [f"delay_s={options.delay_s!r}"] if options.delay_s else []
        changed += [f"quality={options.quality}"] if options.quality != "full" else []
        track = f"track={self.folder / MILDEST}"
        return ["evaluate", short_name(Path(self.checkpoint)), track, *changed]


def search_and_report(checkpoint: str, options: SearchOptions, console: Console) -> dict:
    """Search, write the files, print the figures, and return the content of `search.json`.

    Raises:
        InputError: the checkpoint or family does not exist, or an option is wrong; or the network
            steered NaN, after all files are written.
    """
    check_table(options.table, options.columns, TABLE_COLUMNS)
    space = options.space()
    archive = Archive(options.grid(space))
    load_policy(checkpoint)  # reports a wrong file before processes start
    with command_folder(options.out, "searches") as folder:
        digest = sha256(Path(checkpoint).read_bytes()).hexdigest()
        report = Report(checkpoint, digest, options, space, archive, usual_features(space), folder)
        with (
            opened_driver(checkpoint, options) as drive,
            progress_bar(f"{options.budget} drives", console) as show,
        ):

            def keep(drives: list[Driven]) -> None:
                write_whole(folder / RESULT, json_text(result_of(report, drives)))
                show(len(drives) / options.budget)

            drives = search(options, space, archive, drive, keep)
        result = result_of(report, drives)
        mildest = report.mildest(drives)
        written = [folder / RESULT, _draw(report, drives)]
        if mildest is not None:
            written.append(_write_mildest(report, mildest))
        _print_figures(report, drives, console)
        if options.table is not None:
            table = features_table(report, drives)
            written.append(write_table(table, options.table, options.columns))
        print_written(written, report.replay(mildest) if mildest else [], console)
        steered_nan = sum(one.outcome.nan_frames > 0 for one in drives)
        if steered_nan:
            raise InputError(f"{checkpoint}: steered NaN in {steered_nan} of {len(drives)} drives")
        return result


def result_of(report: Report, drives: list[Driven]) -> dict:
    """Return the content of `search.json`."""
    space, archive = report.space, report.archive
    mildest = report.mildest(drives)
    return {
        "version": VERSION,
        "code": code_fingerprint(),
        "checkpoint": {"file": report.checkpoint, "sha256": report.sha256},
        "options": asdict(report.options),
        "features": {
            key: {"label": one.label, **asdict(one.scale), "usual": report.usual[key]}
            for key, one in space.features.items()
        },
        "cells": {
            "all": archive.grid.cells**2,
            "driven": len(archive.driven),
            "failed": len(archive.failed),
            "counts": [
                {"cell": list(cell), "driven": count, "failed": archive.failed[cell]}
                for cell, count in sorted(archive.driven.items())
            ],
        },
        "failed": sum(one.outcome.failed for one in drives),
        "drives": [_record(report, one) for one in drives],
        "mildest": None
        if mildest is None
        else {
            "drive": drives.index(mildest),
            "command": ["drivezoo", *report.replay(mildest)],
        },
    }


def _record(report: Report, one: Driven) -> dict:
    return {
        "seed": one.candidate.seed,
        "parameters": one.candidate.parameters,
        "weather": weather_text(one.candidate.weather),
        "features": one.candidate.features,
        "distance_to_usual": round(report.distance(one), 4),
        **asdict(one.outcome),
    }


def _draw(report: Report, drives: list[Driven]) -> Path:
    grid, options = report.archive.grid, report.options
    places = [(one.candidate.features[grid.x], one.candidate.features[grid.y]) for one in drives]
    points = [(*place, one.outcome.failed) for place, one in zip(places, drives, strict=True)]
    mildest = report.mildest(drives)
    star = None if mildest is None else places[drives.index(mildest)]
    title = (
        f"{Path(report.checkpoint).name} on {report.space.family.name}, sampler={options.sampler}: "
        f"{len(report.archive.failed)} of {grid.cells**2} cells with an intervention, "
        f"{len(drives)} drives"
    )
    return save_figure(failure_map(report.archive, points, star, title), report.folder / MAP)


def _write_mildest(report: Report, mildest: Driven) -> Path:
    features = ", ".join(f"{key} {value:g}" for key, value in mildest.candidate.features.items())
    text = (
        f"# The mildest road of family={report.options.family} on which a search found a failure,\n"
        f"# with weather={weather_text(mildest.candidate.weather)}, after "
        f"{mildest.outcome.driven_m:.1f} m.\n"
        f"# {features}\n"
    )
    content = yaml.safe_dump(mildest.candidate.content, sort_keys=False)
    return write_whole(report.folder / MILDEST, text + content)


TABLE_COLUMNS = ("feature", "usual", "passed", "failed", "mildest")


def features_table(report: Report, drives: list[Driven]) -> Table:
    """Return a row for each feature: its usual value, its quartiles, and the mildest failure's."""
    mildest = report.mildest(drives)
    features = report.space.features
    usual = [report.usual[key] for key in features]
    worst = [None if mildest is None else mildest.candidate.features[key] for key in features]
    columns = [
        Column(
            "feature",
            "feature",
            [one.label for one in features.values()],
            {"feature": list(features)},
        ),
        Column("usual", "family's usual", [f"{one:.3g}" for one in usual], {"usual": usual}),
    ]
    for name, failed in (("passed", False), ("failed", True)):
        chosen = [drive.candidate for drive in drives if drive.outcome.failed is failed]
        found = [_quartiles([one.features[key] for one in chosen]) for key in features]
        figures = {f"{name}_{part}": [one[part] for one in found] for part in found[0]}
        texts = [_range(one) if chosen else "" for one in found]
        columns.append(Column(name, name, texts, figures))
    texts = ["" if one is None else f"{one:.3g}" for one in worst]
    columns.append(Column("mildest", "mildest failure", texts, {"mildest": worst}))
    return Table(columns, "Features of the roads: median and, in brackets, quartiles.")


def _print_figures(report: Report, drives: list[Driven], console: Console) -> None:
    failed = [one for one in drives if one.outcome.failed]
    console.print(features_table(report, drives).printed())
    archive = report.archive
    console.print(
        f"{len(drives)} drives, {len(failed)} with an intervention; cells: {len(archive.driven)} "
        f"of {archive.grid.cells**2} driven, {len(archive.failed)} with an intervention",
        highlight=False,
    )
    if not failed:
        console.print("no road failed: try a larger budget=, another family= or speed=")


def _quartiles(values: list[float]) -> dict[str, float | None]:
    found = np.percentile(values, [25, 50, 75]).tolist() if values else [None] * 3
    return dict(zip(("q25", "median", "q75"), found, strict=True))


def _range(of: Mapping[str, float | None]) -> str:
    """Return quartiles as text.

    >>> _range({"q25": 8.0, "median": 10.0, "q75": 14.0})
    '10 (8 to 14)'
    """
    return "{median:.3g} ({q25:.3g} to {q75:.3g})".format(**of)
