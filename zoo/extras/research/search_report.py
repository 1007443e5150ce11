"""A search from its options to its files: search.json, map.png and mildest.yaml."""

from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from zoo.base.bounded_files import hash_file
from zoo.base.command_keys import changed
from zoo.base.console_progress import progress_bar
from zoo.base.errors import InputError
from zoo.base.file_text import yaml_text
from zoo.base.new_folder import command_folder
from zoo.base.process_pool import opened_pool
from zoo.base.terminal import counted, print_written, printable
from zoo.base.whole_file import json_text, write_whole
from zoo.checkpoints.checkpoint_path import short_name
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.driving.embedded_world import ROAD
from zoo.extras.research.failure_map import Archive, failure_map
from zoo.extras.research.search_options import SearchOptions
from zoo.extras.research.search_run import (
    BATCH,
    Driven,
    drive_roads,
    feature_distance,
    search,
    sparseness,
    usual_features,
)
from zoo.extras.research.search_space import SearchSpace, weather_text
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.plots import save_figure
from zoo.runs.result_table import Column, Table, number_column

VERSION = 1
RESULT, MAP, MILDEST = "search.json", "map.png", f"{ROAD}.yaml"
TABLE_COLUMNS = ("feature", "usual", "passed", "failed", "mildest")


@dataclass
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
        drives: finished drives.
    """

    checkpoint: str
    sha256: str
    options: SearchOptions
    space: SearchSpace
    archive: Archive
    usual: dict[str, float]
    folder: Path
    drives: list[Driven] = field(default_factory=list)

    def distance(self, driven: Driven) -> float:
        """Return how far a road is from the family's usual one; smaller is milder."""
        return feature_distance(driven.candidate.features, self.usual, self.space)

    @property
    def failed(self) -> list[Driven]:
        """Return the drives that ended with an intervention."""
        return [drive for drive in self.drives if drive.outcome.failed]

    @property
    def mildest(self) -> Driven | None:
        """Return the failure that is nearest to the family's usual road; None without one."""
        return min(self.failed, key=self.distance, default=None)

    def replay(self, driven: Driven) -> list[str]:
        """Return the words after `drivezoo` that drive a road again, as the mildest."""
        words = ["evaluate", short_name(Path(self.checkpoint)), f"track={self.folder / MILDEST}"]
        words.append(f"weather={weather_text(driven.candidate.weather)}")
        keys = ("speed", "frame_rate", "delay_s", "quality")
        return [*words, *(word for word in changed(self.options) if word.partition("=")[0] in keys)]


def search_and_report(checkpoint: str, options: SearchOptions, console: Console) -> dict:
    """Search, write the files, print the figures, and return the content of `search.json`.

    Raises:
        InputError: the checkpoint or family does not exist, or an option is wrong; or the network
            steered NaN, after all files are written.
    """
    options.check_files(TABLE_COLUMNS)
    space = options.space()
    archive = options.archive(space)
    load_policy(checkpoint)  # reports a wrong file before processes start
    with command_folder(options.out, "searches") as folder:
        digest = hash_file(checkpoint)
        report = Report(checkpoint, digest, options, space, archive, usual_features(space), folder)
        with (
            opened_pool(options.workers, most=BATCH) as pool,
            progress_bar(counted(options.budget, "drive"), console) as show,
        ):

            def keep(drives: list[Driven]) -> None:
                report.drives = drives
                if report.mildest is not None:
                    _write_mildest(report, report.mildest)
                write_whole(folder / RESULT, json_text(result_of(report)))
                show(len(drives) / options.budget)

            search(options, space, archive, partial(drive_roads, checkpoint, options, pool), keep)
        mildest, table = report.mildest, features_table(report)
        written = [folder / RESULT, save_figure(draw_map(report), folder / MAP)]
        if mildest is not None:
            written.append(folder / MILDEST)
        console.print(table.printed())
        cells, drives = archive.cells**2, len(report.drives)
        console.print(
            f"{counted(drives, 'drive')}, {len(report.failed)} with an intervention; cells: "
            f"{len(archive.driven)} of {cells} driven, {len(archive.failed)} with an intervention",
            highlight=False,
        )
        if mildest is None:
            console.print("no road failed: try a larger budget=, another family= or speed=")
        written += options.write_files(table)
        print_written(written, report.replay(mildest) if mildest else [], console)
        steered_nan = sum(drive.outcome.nan_frames > 0 for drive in report.drives)
        if steered_nan:
            raise InputError(f"{checkpoint}: steered NaN in {steered_nan} of {drives} drives")
        return result_of(report)


def result_of(report: Report) -> dict:
    """Return the content of `search.json`."""
    archive, mildest, drives = report.archive, report.mildest, report.drives
    is_done, worst = len(drives) == report.options.budget, None
    failed = [drive.candidate.features for drive in report.failed]
    if mildest is not None:
        worst = {"drive": drives.index(mildest), "command": ["drivezoo", *report.replay(mildest)]}
    return {
        "version": VERSION,
        "code": code_fingerprint(),
        "checkpoint": {"file": report.checkpoint, "sha256": report.sha256},
        "options": asdict(report.options),
        "features": {
            key: {"label": feature.label, **asdict(feature.scale), "usual": report.usual[key]}
            for key, feature in report.space.features.items()
        },
        "cells": {
            "all": archive.cells**2,
            "driven": len(archive.driven),
            "failed": len(archive.failed),
            "counts": [
                {"cell": list(cell), "driven": count, "failed": archive.failed[cell]}
                for cell, count in sorted(archive.driven.items())
            ],
        },
        "failed": len(report.failed),
        # Of all pairs of failures, so that it would take long after each batch.
        "sparseness": sparseness(failed, report.space) if is_done else None,
        "drives": [
            {
                "seed": drive.candidate.seed,
                "parameters": drive.candidate.parameters,
                "weather": weather_text(drive.candidate.weather),
                "features": drive.candidate.features,
                "distance_to_usual": round(report.distance(drive), 4),
                **asdict(drive.outcome),
            }
            for drive in drives
        ],
        "mildest": worst,
    }


def draw_map(report: Report) -> Figure:
    """Draw the map of the cells, the drives and the mildest failure."""
    archive, options, mildest = report.archive, report.options, report.mildest
    title = (
        f"{Path(report.checkpoint).name} on {report.space.family.name}, sampler={options.sampler}: "
        f"{len(archive.failed)} of {archive.cells**2} cells with an intervention, "
        + counted(len(report.drives), "drive")
    )
    points = [(drive.candidate.features, drive.outcome.failed) for drive in report.drives]
    return failure_map(archive, points, mildest.candidate.features if mildest else None, title)


def _write_mildest(report: Report, mildest: Driven) -> None:
    features = ", ".join(f"{key} {value:g}" for key, value in mildest.candidate.features.items())
    lines = [
        f"The mildest road of family={report.options.family} on which a search found a failure,",
        f"with weather={weather_text(mildest.candidate.weather)}, after "
        f"{mildest.outcome.driven_m:.1f} m.",
        features,
    ]
    text = "".join(f"# {printable(line)}\n" for line in lines)
    write_whole(report.folder / MILDEST, text + yaml_text(mildest.candidate.content))


def features_table(report: Report) -> Table:
    """Return a row for each feature: its usual value, its quartiles, and the mildest failure's."""
    features, mildest = report.space.features, report.mildest
    labels = [feature.label for feature in features.values()]
    columns = [
        Column("feature", "feature", labels, {"feature": list(features)}),
        number_column("usual", "family's usual", [report.usual[key] for key in features], "{:.3g}"),
    ]
    for name, failed in (("passed", False), ("failed", True)):
        chosen = [drive.candidate for drive in report.drives if drive.outcome.failed is failed]
        quartiles = [_quartiles([road.features[key] for road in chosen]) for key in features]
        figures = {f"{name}_{part}": [cells[part] for cells in quartiles] for part in quartiles[0]}
        form = "{median:.3g} ({q25:.3g} to {q75:.3g})" if chosen else ""
        columns.append(Column(name, name, [form.format(**cells) for cells in quartiles], figures))
    worst = [mildest.candidate.features[key] if mildest else None for key in features]
    columns.append(number_column("mildest", "mildest failure", worst, "{:.3g}"))
    return Table(columns, "Features of the roads: median and, in brackets, quartiles.")


def _quartiles(values: list[float]) -> dict[str, float | None]:
    numbers = np.percentile(values, [25, 50, 75]).tolist() if values else [None] * 3
    return dict(zip(("q25", "median", "q75"), numbers, strict=True))
