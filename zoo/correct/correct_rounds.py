"""The finished rounds of a correction, their file `correct.json` and their table."""

import json
import os
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from zoo.base.errors import InputError
from zoo.base.regular_file import hash_file
from zoo.base.whole_file import write_whole
from zoo.correct.correct_options import CorrectOptions
from zoo.evaluate.drives_table import with_deviation

NAME = "correct.json"
# Options that may differ when a correction is resumed.
MAY_CHANGE = ("rounds", "workers", "out", "enough_m", "trust")


@dataclass(frozen=True)
class Round:
    """A checkpoint and its figures.

    Attributes:
        number: number of the round; 0 is the given checkpoint.
        checkpoint: path of the checkpoint.
        corrections: number of correction rows in its training, from this and earlier rounds.
        tracks: by track, mean and spread of each figure, as in `zoo.evaluate`.
    """

    number: int
    checkpoint: str
    corrections: int
    tracks: dict[str, dict]

    def mean(self, key: str) -> float:
        """Return a figure's mean over the tracks."""
        return sum(figures[key][0] for figures in self.tracks.values()) / len(self.tracks)

    @property
    def rank(self) -> tuple[float, float]:
        """Return the values by which rounds are compared; higher is better."""
        return self.mean("autonomy"), -self.mean("cte_mean_m")


@dataclass(frozen=True)
class Progress:
    """All rounds so far.

    Attributes:
        identity: hash of the checkpoint to correct.
        options, overrides: options and config overrides of the command.
        rounds: finished rounds.
    """

    identity: str
    options: dict
    overrides: list[str]
    rounds: list[Round] = field(default_factory=list)

    @property
    def best(self) -> Round:
        """Return the round that drives best."""
        return max(self.rounds, key=lambda one: one.rank)

    def with_round(self, finished: Round) -> "Progress":
        """Return this progress with one more round."""
        return replace(self, rounds=[*self.rounds, finished])

    def save(self, folder: Path) -> None:
        """Replace the file atomically, and create its folder if needed.

        Raises:
            InputError: the file cannot be written.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            text = json.dumps(asdict(self), indent=1, allow_nan=False)
            write_whole(folder / NAME, f"{text}\n")
        except OSError as error:
            raise InputError(
                f"{folder}: cannot be written ({error.strerror}); name another folder with out="
            ) from None


def open_progress(
    folder: Path, checkpoint: str, options: CorrectOptions, overrides: list[str]
) -> Progress:
    """Return the progress saved in a folder, or a new one.

    Raises:
        InputError: the folder holds a correction of another checkpoint or with
            other options.
    """
    identity = hash_file(checkpoint)[:16]
    given = {key: value for key, value in asdict(options).items() if key not in MAY_CHANGE}
    new = Progress(identity, given, overrides)
    if not os.path.lexists(folder / NAME):
        return new
    from zoo.correct.correct_file import read_correct_file

    try:
        before = read_correct_file(folder / NAME)
        rounds = [Round(**one) for one in before["rounds"]]
        found = Progress(before["identity"], before["options"], before["overrides"], rounds)
    except (InputError, TypeError) as error:
        raise InputError(f"{error}; the file is damaged, name another folder with out=") from None
    if found.identity != identity:
        raise InputError(f"{folder}: corrects another checkpoint; name another folder with out=")
    other = [key for key in given if given[key] != found.options.get(key)]
    if other:
        raise InputError(
            f"{folder}: was started with {other[0]}={found.options.get(other[0])}; give the same "
            "options to resume, or name another folder with out="
        )
    if found.overrides != overrides:
        raise InputError(
            f"{folder}: was started with {' '.join(found.overrides) or 'no overrides'}; give the "
            "same to resume, or name another folder with out="
        )
    for one in found.rounds[1:]:
        if not Path(one.checkpoint).is_file():
            raise InputError(
                f"{one.checkpoint}: this checkpoint is missing; name another folder with out="
            )
    return found


def rounds_table(rounds: list[Round]) -> Table:
    """Return a table with a row for each round and track."""
    count = max(
        (one.get("drives", 1) for each in rounds for one in each.tracks.values()), default=1
    )
    table = Table(
        title="before and after each round",
        title_justify="left",
        caption=f"±: sample standard deviation over {count} start seeds" if count > 1 else None,
        caption_justify="left",
        box=SIMPLE_HEAD,
        collapse_padding=True,
    )
    names = ("round", "track", "rows", "autonomy", "inter-\nventions", "mean\nerror, m", "max, m")
    for name in names:
        table.add_column(name, justify="left" if name == "track" else "right", no_wrap=True)
    for one in rounds:
        for number, (track, figures) in enumerate(one.tracks.items()):
            cells = [
                with_deviation(figures["autonomy"], "{:.1%}"),
                with_deviation(figures["interventions"], "{:.1f}"),
                with_deviation(figures["cte_mean_m"], "{:.2f}"),
                f"{figures['cte_max_m'][0]:.2f}",
            ]
            name, rows = (str(one.number), f"{one.corrections:,}") if not number else ("", "")
            table.add_row("before" if name == "0" else name, Text(track), rows, *cells)
    return table
