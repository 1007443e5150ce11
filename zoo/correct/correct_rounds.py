"""The finished rounds of a correction, their file `correct.json` and their table."""

import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from zoo.base.bounded_files import read_json
from zoo.base.errors import InputError
from zoo.base.regular_file import hash_file
from zoo.base.whole_file import json_text, write_whole
from zoo.correct.correct_options import CorrectOptions
from zoo.evaluate.drives_table import with_deviation
from zoo.runs.record_fields import Fields, Figures, Pair, Whole, check_fields, plain
from zoo.runs.table import Table

if TYPE_CHECKING:
    import rich.table

NAME = "correct.json"
# Options that may differ when a correction is resumed.
MAY_CHANGE = ("rounds", "workers", "out", "enough_m", "trust")
ANOTHER = "name another folder with out="


class Driven(Figures):
    """A track's figures; these four are required, to compare rounds."""

    autonomy: Pair
    interventions: Pair
    cte_mean_m: Pair
    cte_max_m: Pair


class Round(Fields):
    """A checkpoint and its figures by track; round 0 is the given checkpoint.

    Its corrections are the rows of corrections in its training, from this and earlier rounds.
    """

    number: Whole
    checkpoint: str
    corrections: Whole
    tracks: Annotated[dict[str, Driven], Field(min_length=1)]


class Progress(Fields):
    """The fields of `correct.json`: hash of the checkpoint, options, overrides, finished rounds."""

    identity: str
    options: dict
    overrides: list[str]
    rounds: list[Round]


def mean(finished: dict, key: str) -> float:
    """Return the mean of a round's figure over the tracks."""
    return sum(of[key][0] for of in finished["tracks"].values()) / len(finished["tracks"])


def best_round(rounds: Sequence[dict]) -> dict:
    """Return the round that drives best."""
    return max(rounds, key=lambda one: (mean(one, "autonomy"), -mean(one, "cte_mean_m")))


def save(progress: dict, folder: Path) -> None:
    """Replace the file atomically, and create its folder if needed.

    Raises:
        InputError: the file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / NAME, json_text(progress))
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}); {ANOTHER}") from None


def open_progress(
    folder: Path, checkpoint: str, options: CorrectOptions, overrides: list[str]
) -> dict:
    """Return the progress saved in a folder, or a new one, as the fields of `Progress`.

    Raises:
        InputError: the folder holds a correction of another checkpoint or with other options.
    """
    given = {key: value for key, value in asdict(options).items() if key not in MAY_CHANGE}
    new = {"identity": hash_file(checkpoint)[:16], "options": given, "overrides": overrides}
    if not os.path.lexists(folder / NAME):
        return {**new, "rounds": []}
    try:
        found = plain(check_fields(Progress, read_json(folder / NAME), folder / NAME))
    except InputError as error:
        raise InputError(f"{error}; the file is damaged, {ANOTHER}") from None
    if found["identity"] != new["identity"]:
        raise InputError(f"{folder}: corrects another checkpoint; {ANOTHER}")
    before = [f"{key}={found['options'].get(key)}" for key in given]
    other = [word for word, key in zip(before, given, strict=True) if word != f"{key}={given[key]}"]
    if found["overrides"] != overrides:
        other.append(" ".join(found["overrides"]) or "no overrides")
    if other:
        raise InputError(f"{folder}: was started with {other[0]}; give the same, or {ANOTHER}")
    for one in found["rounds"][1:]:
        if not Path(one["checkpoint"]).is_file():
            raise InputError(f"{one['checkpoint']}: this checkpoint is missing; {ANOTHER}")
    return found


def rounds_table(rounds: Sequence[dict]) -> "rich.table.Table":
    """Return a table with a row for each round and track."""
    rows = [
        [
            str(one["number"]) if one["number"] else "before",
            track,
            f"{one['corrections']:,}",
            with_deviation(figures["autonomy"], "{:.1%}"),
            with_deviation(figures["interventions"], "{:.1f}"),
            with_deviation(figures["cte_mean_m"], "{:.2f}"),
            f"{figures['cte_max_m'][0]:.2f}",
        ]
        for one in rounds
        for track, figures in one["tracks"].items()
    ]
    head = ["round", "track", "rows", "autonomy", "interventions", "mean error, m", "max, m"]
    caption = "±: sample standard deviation over the start seeds"
    return Table.of(head, rows).narrow().printed(left=2, caption=caption, caption_justify="left")
