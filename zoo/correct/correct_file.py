"""`correct.json`: the rounds of a correction."""

from pathlib import Path

from zoo.runs.bounded_files import read_json
from zoo.runs.record_fields import Fields, Figures, Whole, check_fields, plain


class Round(Fields):
    """A checkpoint and how it drives."""

    number: Whole
    checkpoint: str
    corrections: Whole
    tracks: dict[str, Figures]


class Correction(Fields):
    """What `zoo.correct.correct_rounds.Progress.save` wrote."""

    identity: str
    options: dict
    overrides: list[str]
    rounds: list[Round]


def read_correct_file(path: Path) -> dict:
    """Return a correction's progress as plain containers; raises InputError."""
    return plain(check_fields(Correction, read_json(path), path))
