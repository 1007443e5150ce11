"""The schema of `correct.json`, the rounds of a correction."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from zoo.base.bounded_files import read_json
from zoo.runs.record_fields import Fields, Figures, Pair, Whole, check_fields, plain


class Driven(Figures):
    """A track's figures; these four are required, to compare rounds."""

    autonomy: Pair
    interventions: Pair
    cte_mean_m: Pair
    cte_max_m: Pair


class Round(Fields):
    """A checkpoint and its figures."""

    number: Whole
    checkpoint: str
    corrections: Whole
    tracks: Annotated[dict[str, Driven], Field(min_length=1)]


class Correction(Fields):
    """The fields that `zoo.correct.correct_rounds.Progress.save` writes."""

    identity: str
    options: dict
    overrides: list[str]
    rounds: list[Round]


def read_correct_file(path: Path) -> dict:
    """Return a correction's progress as plain containers; raises InputError."""
    return plain(check_fields(Correction, read_json(path), path))
