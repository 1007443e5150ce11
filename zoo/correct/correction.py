"""A correction of a checkpoint in several rounds."""

import time
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from zoo.base.errors import InputError
from zoo.base.written_files import remove_written
from zoo.runs.saved_config import TRUST, split_trust

if TYPE_CHECKING:
    from collections.abc import Callable

    from omegaconf import DictConfig

    from zoo.checkpoints.checkpoint import Checkpoint
    from zoo.correct.correct_options import CorrectOptions
    from zoo.correct.correct_rounds import Progress, Round


class Correction:
    """A correction of a checkpoint in several rounds.

    Args:
        path: path of the checkpoint.
        options: options of the correction.
        overrides: overrides of the checkpoint's config.
        folder: folder to write, which this process holds.
        console: console for progress and results.
    """

    def __init__(
        self,
        path: str,
        options: "CorrectOptions",
        overrides: list[str],
        folder: Path,
        console: Console,
    ) -> None:
        from zoo.correct.correct_rounds import open_progress

        self.path, self.options, self.console = path, options, console
        self.checkpoint, self.config = _trainable(path, options, overrides)
        self.folder = folder
        self.progress: Progress = open_progress(self.folder, path, options, overrides)
        self._source = _source(options, self.folder, console)
        self.progress.save(self.folder)

    def run(self) -> "Progress":
        """Run the rounds that are not finished yet.

        Raises:
            InputError: an option or a recording is wrong.
        """
        rounds = self.options.rounds
        if self.options.by_a_person:
            from zoo.correct.person_corrections import ask_person

            rounds = 1
            ask_person(self.options, self.folder)
        self._print_plan(rounds)
        if not self.progress.rounds:
            self._finish(0, self.path, 0)
        while len(self.progress.rounds) <= rounds:
            last = self.progress.rounds[-1]
            if not self.options.by_a_person and self._is_enough(last):
                break
            if not self._correct(last):
                break
        return self.progress

    def _correct(self, last: "Round") -> bool:
        """Run one round; return False if there was nothing to correct."""
        from zoo.correct.correct_training import train_round, training_config

        number = last.number + 1
        place = self.folder / f"round-{number}"
        began = time.perf_counter()
        rows = self._collect(last, place / "recording")
        if not rows:
            self._print(f"round {number}: no driving errors, so nothing to correct")
            return False
        own_split = self._own_split()
        corrections = [self.folder / f"round-{one}" / "recording" for one in range(1, number + 1)]
        config = training_config(
            self.config,
            self.options,
            corrections,
            str(Path(last.checkpoint).absolute()),
            own_split,
            place / "split.csv",
        )
        self._print(
            f"round {number}: {rows:,} rows of corrections ({time.perf_counter() - began:.0f} s); "
            f"training {self.options.epochs} epochs on them and on {last.corrections:,} earlier "
            f"ones, drawn {self.options.weight:g} times as often as other rows"
        )
        checkpoint = train_round(config, place / "run", Path(self.path).absolute().parent.parent)
        self._finish(number, str(checkpoint), last.corrections + rows)
        return True

    def _collect(self, last: "Round", folder: Path) -> int:
        """Create the round's recording unless it exists; return its number of rows."""
        from datamodules.driving_log import read_log
        from datamodules.recording import LOG_NAME

        if not (folder / LOG_NAME).is_file():
            folder.parent.mkdir(parents=True, exist_ok=True)
            return self._source(last.checkpoint, last.number + 1, self.progress.identity, folder)
        return sum(1 for _ in read_log(folder / LOG_NAME))

    def _own_split(self) -> Path:
        from zoo.correct.correct_training import write_own_split

        path = self.folder / "own_split.csv"
        if not path.is_file():
            split = Path(self.path).absolute().parent.parent / "split.csv"
            write_own_split(self.config, self.checkpoint, split, path, self.console)
        return path

    def _finish(self, number: int, checkpoint: str, corrections: int) -> None:
        """Score a round's checkpoint and save the round as finished."""
        from zoo.correct.correct_rounds import Round
        from zoo.evaluate.track_scores import how_well, score_on_tracks

        drives = self.folder / f"round-{number}" / "drives"
        remove_written(drives)  # left by a stopped correction
        options = self.options
        found = score_on_tracks(checkpoint, options.scored, drives, self.console, options.workers)
        finished = Round(number, checkpoint, corrections, found.tracks)
        self.progress = self.progress.with_round(finished)
        self.progress.save(self.folder)
        for track, figures in found.tracks.items():
            self._print(f"round {number}, {track}: {how_well(figures)}")

    def _is_enough(self, last: "Round") -> bool:
        enough = (
            last.mean("interventions") == 0 and last.mean("cte_mean_m") <= self.options.enough_m
        )
        if enough:
            self._print(
                "it drives without interventions, mean cross-track error "
                f"{last.mean('cte_mean_m'):.2f} m (enough_m={self.options.enough_m:g}): no further "
                "round is needed"
            )
        return enough

    def _print_plan(self, rounds: int) -> None:
        from zoo.correct.correct_options import FIRST_SEED
        from zoo.verdict.evidence import no_verdict, source_of

        if source := source_of(self.checkpoint.data):
            self._print(no_verdict(source))
        done = len(self.progress.rounds) - 1
        if done >= 0:
            self._print(f"{self.folder}: resumed after round {done}")
        source = "a person's corrections, one round"
        if not self.options.by_a_person:
            source = (
                f"the expert's corrections in up to {rounds} rounds, from drives with start seeds "
                f"from {FIRST_SEED}"
            )
        self._print(
            f"{self.path}: {source}; scored with start seeds 0 to {self.options.seeds - 1}, from "
            "which no corrections come"
        )

    def _print(self, text: str) -> None:
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)


def _trainable(
    path: str, options: "CorrectOptions", overrides: list[str]
) -> "tuple[Checkpoint, DictConfig]":
    from zoo.checkpoints.checkpoint import load_checkpoint
    from zoo.checkpoints.policy import CheckpointPolicy
    from zoo.correct.correct_training import own_config
    from zoo.worlds.run_drives import check_throttle

    if Path(path).suffix == ".onnx":
        raise InputError(
            f"{path}: an ONNX file cannot be trained; name the checkpoint that it was exported from"
        )
    checkpoint = load_checkpoint(path)
    check_throttle(CheckpointPolicy(checkpoint), options.throttle)
    _, trusted = split_trust([f"{TRUST}={options.trust}"])
    return checkpoint, own_config(checkpoint, overrides, path, trusted)


def _source(
    options: "CorrectOptions", out: Path, console: Console
) -> "Callable[[str, int, str, Path], int]":
    """Return the function that creates a round's recording and returns its number of rows.

    Its arguments are the checkpoint, the round's number, the identity and the folder.
    """
    if options.by_a_person:
        from zoo.correct.person_corrections import check_person, corrections_of_a_person

        check_person(options)
        return lambda _checkpoint, _number, _identity, folder: corrections_of_a_person(
            options, out, folder
        )
    from zoo.correct.collecting import collect

    return lambda checkpoint, number, identity, folder: collect(
        checkpoint, options, number, identity, folder, console
    )
