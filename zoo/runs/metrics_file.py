"""`metrics.json`: a run's figures, as this and earlier versions wrote them."""

from pathlib import Path

from zoo.runs.bounded_files import read_json
from zoo.runs.record_fields import Fields, Figures, Number, Whole, check_fields, plain

NAME = "metrics.json"


class Scores(Fields):
    """Open-loop figures of a part's rows."""

    mse: Number | None = None
    mae: Number | None = None
    balanced_mae: Number | None = None
    bias: Number | None = None


class Driving(Fields):
    """How a run drove; the earliest versions scored one track, without `tracks`."""

    tracks: dict[str, Figures | None] | None = None
    seeds: Whole | None = None
    speed_mph: Number | None = None
    laps: Number | None = None
    drives: list[dict] | None = None


class Data(Fields):
    """The recordings."""

    fingerprint: str | None = None
    rows: Whole | None = None
    split: dict[str, Whole] | None = None


class Code(Fields):
    """The code that trained."""

    hash: str
    commit: str | None = None


class Metrics(Fields):
    """What `metrics.json` holds; all may be missing in a file of another version."""

    model: str | None = None
    parameters: Whole | None = None
    open_loop: dict[str, Scores] | None = None
    side_response: dict[str, Number | None] | None = None
    baselines: dict[str, dict[str, Scores]] | None = None
    drive: Driving | None = None
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
    data: Data | None = None
    findings: list[dict] | None = None
    code: Code | None = None
    versions: dict[str, str | None] | None = None
    verdict: dict | None = None


def read_metrics_file(folder: Path) -> dict:
    """Return a run's figures as plain containers, each of the type that `Metrics` names.

    Raises:
        InputError: there is no `metrics.json`, or one that cannot be read.
    """
    path = folder / NAME
    return plain(check_fields(Metrics, read_json(path), path))
