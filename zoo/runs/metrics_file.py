"""The only writer and reader of `metrics.json`, of a run, an evaluation or a replay."""

from pathlib import Path

from zoo.base.plain_files import check_version, read_json
from zoo.base.whole_file import json_text, write_whole
from zoo.runs.code_fingerprint import CodeFacts
from zoo.runs.record_fields import Fields, Figures, Number, Whole, check_fields, plain

NAME = "metrics.json"
VERSION = 1
Scores = dict[str, Number | None]  # open-loop figures of one part of the split


class Driving(Fields):
    """Figures of driving."""

    tracks: dict[str, Figures | None] | None = None
    seeds: Whole | None = None
    speed_mph: Number | None = None
    laps: Number | None = None
    drives: list[dict] | None = None
    replayed: str | None = None


class Data(Fields):
    """The recordings."""

    fingerprint: str | None = None
    rows: Whole | None = None
    split: dict[str, Whole] | None = None


class Metrics(Fields):
    """The contents of `metrics.json`.

    An evaluation has `checkpoint`, `settings`, `drives`, `tracks`, `perturbed` and `verdict`; a
    replay has `checkpoint`, `recording`, `replayed`, `margin_m` and `replay`; a challenge
    `checkpoint`, `recording` and `challenge`.
    """

    version: Whole
    model: str | None = None
    parameters: Whole | None = None
    open_loop: dict[str, Scores] | None = None
    side_response: dict[str, Number | None] | None = None
    baselines: dict[str, dict[str, Scores]] | None = None
    drive: Driving | None = None
    not_replayed: str | None = None
    closed_loop: dict | None = None
    leak: dict | None = None
    epochs: Whole | None = None
    train_samples: Whole | None = None
    best_epoch: Whole | None = None
    choice: dict | None = None
    samples_per_second: Number | None = None
    seconds_per_epoch: Number | None = None
    wall_s: Number | None = None
    seed: Whole | None = None
    device: str | None = None
    threads: Whole | None = None
    precision: str | None = None
    data: Data | None = None
    findings: list[dict] | None = None
    code: CodeFacts | None = None
    versions: dict[str, str | None] | None = None
    verdict: dict | None = None
    checkpoint: str | None = None
    settings: dict[str, str] | None = None
    drives: list[dict] | None = None
    tracks: dict[str, Figures | None] | None = None
    perturbed: dict[str, list[dict]] | None = None
    recording: list[str] | None = None
    replayed: str | None = None
    margin_m: Number | None = None
    replay: dict | None = None
    challenge: dict | None = None


def write_metrics_file(folder: Path, metrics: dict) -> Path:
    """Write `metrics.json` in this version's format, with null for NaN; return its path."""
    return write_whole(folder / NAME, json_text({"version": VERSION, **metrics}))


def read_metrics_file(folder: Path) -> dict:
    """Return the figures as plain containers, with the types of `Metrics`.

    Raises:
        InputError: `metrics.json` is missing, cannot be read or has another version.
    """
    path = folder / NAME
    metrics = check_fields(Metrics, read_json(path), path)
    check_version(metrics.version, VERSION, path)
    return plain(metrics)
