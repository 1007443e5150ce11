"""Choose `best.ckpt` at the end of a run: the candidate that drives best.

Validation error hardly predicts driving (`docs/offline_metrics.md`): the epoch with the lowest
error is often the first, which hardly steers. The candidates' starts differ from the starts of the
score, so that the score is not the best of several attempts.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import lightning
from lightning.pytorch.callbacks import ModelCheckpoint
from rich.console import Console

from zoo.base.errors import InputError
from zoo.base.process_pool import KilledProcessError
from zoo.base.terminal import counted, print_line
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint import read_checkpoint_file, trained_epochs
from zoo.driving.drive_log import KeptFigures
from zoo.driving.interventions import driving_score
from zoo.driving.run_drives import all_drives
from zoo.scoring.track_scores import RunScore, driving_line
from zoo.simulator.track_names import full_name
from zoo.training.closed_loop import DRIVEN, DROVE
from zoo.training.run_module import is_trial

START_SEED = 1000  # the score's seeds count from 0
BEST, MONITORED = "best.ckpt", "monitored.ckpt"
FIGURES = ("autonomy", "interventions", "cte_mean_m", "driven_s")
# In the order in which ties are broken.
SOURCES = {BEST: "", DRIVEN: "best drive while training", "last.ckpt": "last epoch"}


def choose_best(
    score: RunScore | None,
    monitor: str | None,
    folder: Path,
    console: Console,
    source: str | None = None,
) -> dict | None:
    """Save the candidate that drives best as `best.ckpt`; print which one and why.

    If that is not the checkpoint that the monitored figure chose, the latter is kept as
    `monitored.ckpt`.

    Args:
        score: settings of the run's score; each candidate drives `candidate_laps` on the first
            track. With None or 0 laps nothing is driven and the monitored checkpoint is kept.
        monitor: name of the figure that chose `best.ckpt` during training, such as `val/mse`. One
            of a drive has chosen: no candidate drives.
        folder: run's folder.
        console: console for the choice.
        source: other car of the recording, with which no candidate is driven on a track; None for
            Udacity's.

    Returns:
        `choice` of `metrics.json`: `epoch` of `best.ckpt`, counted from 1; `why`, a sentence; and
        `drives`: for each candidate that was driven, `file`, `what`, `epoch`, `score` and the
        figures of its drive, the best first. None where the run keeps no `best.ckpt`.

    Raises:
        KilledProcessError: a process that drove was killed; the resumed run drives again.
    """
    checkpoints = folder / "checkpoints"
    candidates = find_candidates(checkpoints, monitor)
    if not candidates or candidates[0]["file"] != BEST:
        return None
    best, why, drives = candidates[0], candidates[0]["what"], []
    if len(candidates) == 1:
        why += "; no other candidate"
    elif source is not None:
        why += f"; none was driven: the tracks show another car than its recording ({source})"
    elif (monitor or "").startswith(DROVE):
        why += ", by which a drive chose it"
    elif score is None or not score.candidate_laps:
        key = "score=none" if score is None else "score.candidate_laps=0"
        why += f"; no candidate was driven ({key}), and this figure hardly predicts driving"
    else:
        try:
            drives = _drive(score, checkpoints, candidates, console)
        except KilledProcessError:  # the memory that was free must not choose
            raise
        except InputError as error:  # without a simulator the monitored checkpoint is kept
            why += f"; not driven: {error}"
        else:
            best = drives[0]
            lost = best["interventions"]
            ties = sum(drive["interventions"] == lost for drive in drives)
            why = f"{best['what']}, and it drives best of {len(drives)} candidates"
            if ties > 1:
                why = f"{best['what']}; a tie: {ties} of {len(drives)} candidates have "
                why += f"{counted(lost, 'intervention')} each, so error and time decided"
            take(checkpoints, best["file"])
    print_line(console, f"best.ckpt is of epoch {best['epoch']}: {why}")
    return {"epoch": best["epoch"], "why": why, "drives": drives}


def monitored_figure(trainer: lightning.Trainer) -> str | None:
    """Return the figure that chose `best.ckpt`; None if that is the last epoch's."""
    for writer in _writers(trainer):
        if Path(writer.filename or "").stem == "best" and writer.best_model_path:
            return writer.monitor
    return None


def complete_checkpoints(trainer: lightning.Trainer, folder: Path) -> None:
    """Save the checkpoints that no epoch left: of no training, or one without a validation."""
    checkpoints = folder / "checkpoints"
    for writer in _writers(trainer):
        path, last = checkpoints / f"{writer.filename}.ckpt", checkpoints / "last.ckpt"
        if path.stem not in ("best", "last") or path.is_file() or is_trial(trainer):
            continue
        if last.is_file():
            write_whole(path, last.read_bytes())
        else:
            trainer.save_checkpoint(path)


def _writers(trainer: lightning.Trainer) -> list[ModelCheckpoint]:
    return [c for c in trainer.checkpoint_callbacks if isinstance(c, ModelCheckpoint)]


def find_candidates(checkpoints: Path, monitor: str | None) -> list[dict]:
    """Return `file`, `what` and `epoch` of a run's distinct checkpoints, the monitored one first.

    `what` is the reason why it is a candidate, such as `lowest val/mse`.
    """
    candidates: dict[int, dict] = {}
    for file, what in SOURCES.items():
        if (path := checkpoints / file).is_file():
            epoch = trained_epochs(read_checkpoint_file(path))
            what = (what or monitored_as(monitor)) if epoch else "the initial weights"
            candidates.setdefault(epoch, {"file": file, "what": what, "epoch": epoch})
    return list(candidates.values())


def monitored_as(monitor: str | None) -> str:
    """Return what a monitored figure chooses, in words.

    >>> monitored_as("val/mse"), monitored_as("drive/autonomy"), monitored_as(None)
    ('lowest val/mse', 'best drive/autonomy', 'last epoch')
    """
    if monitor is None:
        return "last epoch"
    return f"{'lowest' if mode_of(monitor) == 'min' else 'best'} {monitor}"


def mode_of(monitor: str) -> str:
    """Return Lightning's `mode` of a figure of ours: whether the least or the greatest is best."""
    less = any(word in monitor for word in ("mse", "mae", "loss", "cte", "interventions"))
    return "min" if less else "max"


def take(checkpoints: Path, file: str) -> None:
    """Save a candidate as `best.ckpt`; if the process is killed, the file is still complete."""
    best, monitored = checkpoints / BEST, checkpoints / MONITORED
    monitored.unlink(missing_ok=True)
    if file == BEST:
        return
    write_whole(monitored, best.read_bytes())
    write_whole(best, (checkpoints / file).read_bytes())


def restore_monitored(folder: Path) -> None:
    """Undo the choice of a finished run that is trained further.

    Its next epochs compare with the monitored checkpoint, as if the run had not ended.
    """
    if (monitored := folder / "checkpoints" / MONITORED).is_file():
        monitored.replace(folder / "checkpoints" / BEST)


def _drive(
    score: RunScore, checkpoints: Path, candidates: Sequence[dict], console: Console
) -> list[dict]:
    """Drive each candidate once, from the same start; print and return their drives.

    The embedded simulator draws less detail far away: `quality=fast`, or the score's `simple`.
    """
    laps, track = min(score.candidate_laps, score.laps), score.tracks[0]
    scenario = score.one_drive(track=track, seed=START_SEED, laps=laps)
    if scenario.world == "embedded" and scenario.quality == "full":
        # In half the time; networks drive as well (docs/simulator.md, Renderers).
        scenario = replace(scenario, quality="fast")
    scenarios = [scenario] * len(candidates)
    driven = all_drives(
        [str(checkpoints / candidate["file"]) for candidate in candidates],
        scenarios,
        KeptFigures(),
        score.workers,
        driving_line(scenarios),
        console,
    )
    drives = []
    print_line(
        console,
        f"candidates for best.ckpt, {counted(laps, 'lap')} of {full_name(track)} each, "
        f"{'as score.laps, ' * (laps < score.candidate_laps)}from another start than the score:",
    )
    for candidate, figures in zip(candidates, driven, strict=True):
        count, error = figures["interventions"], figures["cte_mean_m"]
        value = driving_score(count, figures["driven_s"], error)
        drives.append(candidate | {key: figures[key] for key in FIGURES} | {"score": value})
        print_line(
            console,
            f"  epoch {candidate['epoch']:>3}, {candidate['what']}: autonomy "
            f"{figures['autonomy']:.1%}, {counted(count, 'intervention')}, mean "
            f"error {error:.2f} m",
        )
    return sorted(drives, key=lambda drive: -drive["score"])  # stable: ties keep their order
