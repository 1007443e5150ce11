"""Choose `best.ckpt` at the end of a run: the candidate that drives best.

Validation error hardly predicts driving (`docs/offline_metrics.md`): the epoch with the lowest
error is often the first, which hardly steers. The candidates' starts differ from the starts of the
score, so that the score is not the best of several attempts.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console

from simulator.track_names import short_name
from zoo.base.errors import InputError
from zoo.base.terminal import print_line
from zoo.base.whole_file import write_whole
from zoo.callbacks.closed_loop import DRIVEN
from zoo.checkpoints.checkpoint import read_checkpoint_file
from zoo.drives.interventions import driving_score
from zoo.evaluate.track_scores import KeptDrive, RunScore, driving_line
from zoo.worlds.run_drives import all_drives

START_SEED = 1000  # the score's seeds count from 0
BEST, MONITORED = "best.ckpt", "monitored.ckpt"
# In the order in which ties are broken.
SOURCES = {BEST: "", DRIVEN: "best drive while training", "last.ckpt": "last epoch"}


@dataclass(frozen=True)
class Candidate:
    """A checkpoint that may become `best.ckpt`.

    Attributes:
        file: name in the folder of checkpoints.
        what: reason why it is a candidate, such as `lowest val/mse`.
        epoch: epoch after which it was saved, counted from 1.
    """

    file: str
    what: str
    epoch: int


@dataclass(frozen=True)
class Choice:
    """The checkpoint that became `best.ckpt`.

    Attributes:
        epoch: epoch after which it was saved, counted from 1.
        why: reason, a sentence.
        drives: for each candidate that was driven, `file`, `what`, `epoch`, `score` and the figures
            `autonomy`, `interventions`, `cte_mean_m`, `driven_s`; the best first.
    """

    epoch: int
    why: str
    drives: tuple[dict, ...] = ()

    def plain(self) -> dict:
        """Return plain containers, for `metrics.json`."""
        return asdict(self) | {"drives": list(self.drives)}


def choose_best(
    score: RunScore | None, monitor: str | None, folder: Path, console: Console
) -> Choice | None:
    """Save the candidate that drives best as `best.ckpt`; print which one and why.

    If that is not the checkpoint that the monitored figure chose, the latter is kept as
    `monitored.ckpt`.

    Args:
        score: settings of the run's score; each candidate drives `candidate_laps` on the first
            track. With None or 0 laps nothing is driven and the monitored checkpoint is kept.
        monitor: name of the figure that chose `best.ckpt` during training, such as `val/mse`.
        folder: run's folder.
        console: console for the choice.

    Returns:
        The choice; None where the run keeps no `best.ckpt`.
    """
    checkpoints = folder / "checkpoints"
    candidates = find_candidates(checkpoints, monitor)
    if not candidates or candidates[0].file != BEST:
        return None
    if score is None or not score.candidate_laps or len(candidates) == 1:
        choice = Choice(candidates[0].epoch, _undriven(score, candidates))
    else:
        try:
            drives = _drive(score, checkpoints, candidates, console)
        except InputError as error:  # without a simulator the monitored checkpoint is kept
            choice = Choice(candidates[0].epoch, f"{candidates[0].what}; not driven: {error}")
        else:
            choice = _decide(candidates[0], drives)
            _print_drives(score, drives, console)
            take(checkpoints, drives[0]["file"])
    line = f"best.ckpt is of epoch {choice.epoch}: {choice.why}"
    print_line(console, line)
    return choice


def find_candidates(checkpoints: Path, monitor: str | None) -> list[Candidate]:
    """Return a run's distinct checkpoints, the monitored one first."""
    candidates: dict[int, Candidate] = {}
    for file, what in SOURCES.items():
        path = checkpoints / file
        if path.is_file():
            epoch = int(read_checkpoint_file(path)["epoch"]) + 1
            candidates.setdefault(epoch, Candidate(file, what or monitored_as(monitor), epoch))
    return list(candidates.values())


def monitored_as(monitor: str | None) -> str:
    """Return what a monitored figure chooses, in words.

    >>> monitored_as("val/mse"), monitored_as("drive/autonomy"), monitored_as(None)
    ('lowest val/mse', 'best drive/autonomy', 'last epoch')
    """
    if monitor is None:
        return "last epoch"
    less = any(word in monitor for word in ("mse", "mae", "loss", "cte", "interventions"))
    return f"{'lowest' if less else 'best'} {monitor}"


def take(checkpoints: Path, file: str) -> None:
    """Save a candidate as `best.ckpt`; if the process is killed, the file is still complete."""
    best, monitored = checkpoints / BEST, checkpoints / MONITORED
    monitored.unlink(missing_ok=True)
    if file == BEST:
        return
    chosen = (checkpoints / file).read_bytes()
    write_whole(monitored, best.read_bytes())
    write_whole(best, chosen)


def restore_monitored(folder: Path) -> None:
    """Undo the choice of a finished run that is trained further.

    Its next epochs compare with the monitored checkpoint, as if the run had not ended.
    """
    monitored = folder / "checkpoints" / MONITORED
    if monitored.is_file():
        monitored.replace(folder / "checkpoints" / BEST)


def _laps(score: RunScore) -> float:
    return min(score.candidate_laps, score.laps)


def _drive(
    score: RunScore, checkpoints: Path, candidates: Sequence[Candidate], console: Console
) -> list[dict]:
    """Drive each candidate once, from the same start; return `Choice.drives`."""
    scenario = score.one_drive(
        track=score.tracks[0], seed=START_SEED, laps=_laps(score), guard=None
    )
    scenarios = [scenario] * len(candidates)
    driven = all_drives(
        [str(checkpoints / candidate.file) for candidate in candidates],
        scenarios,
        KeptDrive(),
        score.workers,
        driving_line(scenarios),
        console,
    )
    keys = ("autonomy", "interventions", "cte_mean_m", "driven_s")
    drives = [
        asdict(candidate) | {key: figures[key] for key in keys} | {"score": _score(figures)}
        for candidate, figures in zip(candidates, driven, strict=True)
    ]
    return sorted(drives, key=lambda drive: -drive["score"])  # stable: ties keep their order


def _score(figures: dict) -> float:
    return driving_score(figures["interventions"], figures["driven_s"], figures["cte_mean_m"])


def _decide(monitored: Candidate, drives: Sequence[dict]) -> Choice:
    best = drives[0]
    why = f"{best['what']}, and it drives best of {len(drives)} candidates"
    if best["file"] != monitored.file:
        own = next(drive for drive in drives if drive["file"] == monitored.file)
        why = (
            f"{best['what']}; it drives better than the {monitored.what} of epoch "
            f"{monitored.epoch} (autonomy {best['autonomy']:.1%} against {own['autonomy']:.1%}, "
            f"mean error {best['cte_mean_m']:.2f} m against {own['cte_mean_m']:.2f} m)"
        )
    return Choice(best["epoch"], why, tuple(drives))


def _undriven(score: RunScore | None, candidates: Sequence[Candidate]) -> str:
    first = candidates[0].what
    if len(candidates) == 1:
        return f"{first}; no other candidate"
    key = "score=none" if score is None else "score.candidate_laps=0"
    return f"{first}; no candidate was driven ({key}), and this figure hardly predicts driving"


def _print_drives(score: RunScore, drives: Sequence[dict], console: Console) -> None:
    laps = f"{_laps(score):g} lap{'' if _laps(score) == 1 else 's'}"
    track = short_name(score.tracks[0])
    lines = [
        f"candidates for best.ckpt, {laps} of the {track} each, from another start than the score:"
    ]
    for row in sorted(drives, key=lambda row: row["epoch"]):
        count = row["interventions"]
        lines.append(
            f"  epoch {row['epoch']:>3}, {row['what']}: autonomy {row['autonomy']:.1%}, {count} "
            f"intervention{'' if count == 1 else 's'}, mean error {row['cte_mean_m']:.2f} m"
        )
    for line in lines:
        print_line(console, line)
