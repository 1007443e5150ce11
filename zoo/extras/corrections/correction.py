"""A correction of a checkpoint in several rounds, their file `correct.json` and their table."""

import os
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from pydantic import Field
from rich.console import Console
from rich.table import Table as PrintedTable

from datamodules.driving_log import read_log
from datamodules.recording import LOG_NAME
from zoo.base.bounded_files import hash_file
from zoo.base.errors import InputError, file_errors
from zoo.base.plain_files import read_json
from zoo.base.terminal import counted
from zoo.base.whole_file import json_text, write_whole
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.onnx_policy import is_onnx
from zoo.driving.drives_table import with_deviation
from zoo.driving.run_drives import check_throttle
from zoo.extras.corrections.collecting import collect
from zoo.extras.corrections.correct_options import FIRST_SEED, CorrectOptions
from zoo.extras.corrections.correct_training import (
    own_config,
    train_round,
    training_config,
    write_own_split,
)
from zoo.extras.corrections.person_corrections import (
    ask_person,
    check_person,
    check_unchanged,
    corrections_of_a_person,
)
from zoo.runs.record_fields import Fields, Figures, Pair, Whole, check_fields, plain
from zoo.runs.result_table import Table
from zoo.runs.saved_config import TRUST, split_trust
from zoo.scoring.evaluate_options import track_names
from zoo.scoring.evidence import other_car_line, with_track
from zoo.scoring.track_scores import how_well, remove_drives, score_on_tracks
from zoo.simulator.track_names import DRAWN

NAME = "correct.json"
# Options that may differ when a correction is resumed.
MAY_CHANGE = ("rounds", "workers", "out", "enough_m", "trust")
ANOTHER = "name another folder with out="


class Correction:
    """A correction of a checkpoint in several rounds.

    Args:
        path: path of the checkpoint.
        options: options of the correction.
        overrides: overrides of the checkpoint's config.
        folder: folder to write, which this process holds.
        console: console for progress and results.

    Raises:
        InputError: an option, the checkpoint, its config or a person's corrections are wrong.
    """

    def __init__(
        self,
        path: str,
        options: CorrectOptions,
        overrides: list[str],
        folder: Path,
        console: Console,
    ) -> None:
        self.path, self.folder, self.console = path, folder, console
        if is_onnx(path):
            raise InputError(
                f"{path}: an ONNX file cannot be trained; name the checkpoint that it was exported "
                "from"
            )
        self.run_folder = Path(path).absolute().parent.parent
        self.checkpoint = load_checkpoint(path)
        self.options = options = with_track(options, path, self.checkpoint.data)
        check_throttle(CheckpointPolicy(self.checkpoint), options.throttle)
        _, trusted = split_trust([f"{TRUST}={options.trust}"])
        self.config = own_config(self.checkpoint, overrides, path, trusted)
        self.progress = open_progress(folder, path, options, overrides)
        if options.by_a_person:
            check_person(options)
        save(self.progress, folder)

    def run(self) -> list[dict]:
        """Run the rounds that are not finished yet, and return all rounds.

        Raises:
            InputError: an option or a recording is wrong.
        """
        rounds, most = self.progress["rounds"], self.options.rounds
        if self.options.by_a_person:
            most = 1
            ask_person(self.options, self.folder)
            check_unchanged(self.options, self.folder, self.folder / "round-1" / "recording")
        self._print_plan(most)
        if not rounds:
            self._finish(0, str(Path(self.path).absolute()), 0)
        while len(rounds) <= most and not self._is_enough(rounds[-1]):
            if not self._correct(rounds[-1]):
                break
        return rounds

    def _correct(self, last: dict) -> bool:
        """Run one round; return False if there was nothing to correct."""
        number, options = last["number"] + 1, self.options
        folder, began = self.folder / f"round-{number}", time.perf_counter()
        rows = self._collect(last["checkpoint"], number, folder / "recording")
        if not rows:
            self._print(f"round {number}: no driving errors, so nothing to correct")
            return False
        own_split = self.folder / "own_split.csv"
        if not own_split.is_file():
            run_split = self.run_folder / "split.csv"
            write_own_split(self.config, self.checkpoint, run_split, own_split, self.console)
        corrections = [self.folder / f"round-{done}" / "recording" for done in range(1, number + 1)]
        start, split = last["checkpoint"], folder / "split.csv"
        config = training_config(self.config, options, corrections, start, own_split, split)
        samples = config.data.get("samples_per_epoch") or "all"  # fewer after quick=true
        self._print(
            f"round {number}: {counted(rows, 'row')} of corrections "
            f"({time.perf_counter() - began:.0f} s); training {counted(options.epochs, 'epoch')} "
            f"of {samples} samples on them and on {last['corrections']:,} earlier ones, drawn "
            f"{options.weight:g} times as often as other rows"
        )
        checkpoint = train_round(config, folder / "run", self.run_folder)
        self._finish(number, str(checkpoint), last["corrections"] + rows)
        return True

    def _collect(self, checkpoint: str, number: int, folder: Path) -> int:
        """Create the round's recording unless it exists; return its number of rows."""
        if (folder / LOG_NAME).is_file():
            return sum(1 for _ in read_log(folder / LOG_NAME))
        folder.parent.mkdir(parents=True, exist_ok=True)
        if self.options.by_a_person:
            return corrections_of_a_person(self.options, self.folder, folder)
        identity = self.progress["identity"]
        return collect(checkpoint, self.options, number, identity, folder, self.console)

    def _finish(self, number: int, checkpoint: str, corrections: int) -> None:
        """Score a round's checkpoint and save the round as finished."""
        drives, options = self.folder / f"round-{number}" / "drives", self.options
        remove_drives(drives)  # left by a stopped correction
        scores = score_on_tracks(checkpoint, options.scored, drives, self.console, options.workers)
        finished = {"number": number, "checkpoint": checkpoint, "corrections": corrections}
        self.progress["rounds"].append(finished | {"tracks": scores.tracks})
        save(self.progress, self.folder)
        for track, figures in scores.tracks.items():
            self._print(f"round {number}, {track}: {how_well(figures)}")

    def _is_enough(self, last: dict) -> bool:
        """Return whether a checkpoint drives so well that the expert need not correct it."""
        error_m, enough_m = mean(last, "cte_mean_m"), self.options.enough_m
        if self.options.by_a_person or mean(last, "interventions") or error_m > enough_m:
            return False
        self._print(
            f"it drives without interventions, mean cross-track error {error_m:.2f} m "
            f"(enough_m={enough_m:g}): no further round is needed"
        )
        return True

    def _print_plan(self, rounds: int) -> None:
        if line := other_car_line(self.checkpoint.data, self.options.track):
            self._print(line)
        if self.progress["rounds"]:
            self._print(f"{self.folder}: resumed after round {len(self.progress['rounds']) - 1}")
        corrections = "a person's corrections, one round"
        if not self.options.by_a_person:
            corrections = (
                f"the expert's corrections in up to {counted(rounds, 'round')}, from drives with "
                f"start seeds from {FIRST_SEED}"
            )
        self._print(
            f"{self.path}: {corrections}; scored with {counted(self.options.seeds, 'start seed')} "
            "from 0 on, from which no corrections come"
        )

    def _print(self, text: str) -> None:
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)


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
    return max(rounds, key=lambda row: (mean(row, "autonomy"), -mean(row, "cte_mean_m")))


def save(progress: dict, folder: Path) -> None:
    """Replace the file atomically, and create its folder if needed.

    Raises:
        InputError: the file cannot be written.
    """
    with file_errors(folder, f"cannot be written ({{}}); {ANOTHER}"):
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / NAME, json_text(progress))


def open_progress(
    folder: Path, checkpoint: str, options: CorrectOptions, overrides: list[str]
) -> dict:
    """Return the progress saved in a folder, or a new one, as the fields of `Progress`.

    Raises:
        InputError: the folder holds a correction of another checkpoint or with other options.
    """
    asked = {key: value for key, value in asdict(options).items() if key not in MAY_CHANGE}
    roads = [Path(DRAWN.sub(r"\1", name)) for name in track_names(options.track)]
    asked |= {str(road): hash_file(road)[:16] for road in roads if road.is_file()}  # may be edited
    new = {"identity": hash_file(checkpoint)[:16], "options": asked, "overrides": overrides}
    if not os.path.lexists(folder / NAME):
        return {**new, "rounds": []}
    try:
        saved = plain(check_fields(Progress, read_json(folder / NAME), folder / NAME))
    except InputError as error:
        raise InputError(f"{error}; the file is damaged, {ANOTHER}") from None
    if saved["identity"] != new["identity"]:
        raise InputError(f"{folder}: corrects another checkpoint; {ANOTHER}")
    before = [f"{key}={saved['options'].get(key)}" for key in asked]
    other = [word for word, key in zip(before, asked, strict=True) if word != f"{key}={asked[key]}"]
    if saved["overrides"] != overrides:
        other.append(" ".join(saved["overrides"]) or "no overrides")
    if other:
        raise InputError(f"{folder}: was started with {other[0]}; give the same, or {ANOTHER}")
    for row in saved["rounds"][:1]:  # of this checkpoint, wherever it was
        row["checkpoint"] = str(Path(checkpoint).absolute())
    for row in saved["rounds"][1:]:
        if not Path(row["checkpoint"]).is_file():
            raise InputError(f"{row['checkpoint']}: this checkpoint is missing; {ANOTHER}")
    return saved


def rounds_table(rounds: Sequence[dict]) -> PrintedTable:
    """Return a table with a row for each round and track."""
    rows = [
        [
            str(row["number"]) if row["number"] else "before",
            track,
            f"{row['corrections']:,}",
            with_deviation(figures["autonomy"], "{:.1%}"),
            with_deviation(figures["interventions"], "{:.1f}"),
            with_deviation(figures["cte_mean_m"], "{:.2f}"),
            f"{figures['cte_max_m'][0]:.2f}",
        ]
        for row in rounds
        for track, figures in row["tracks"].items()
    ]
    head = ["round", "track", "rows", "autonomy", "interventions", "mean error, m", "max, m"]
    several = any("±" in cell for row in rows for cell in row)
    caption = "±: sample standard deviation over the start seeds" if several else None
    return Table.of(head, rows).narrow().printed(left=2, caption=caption, caption_justify="left")
