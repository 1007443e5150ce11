"""The guard command from its options to its files."""

import time
from dataclasses import replace

import numpy as np
from rich.console import Console

from zoo.base.bounded_files import hash_file
from zoo.base.errors import InputError
from zoo.base.new_folder import command_folder
from zoo.base.terminal import print_written
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.policy import CheckpointPolicy, load_policy
from zoo.cli.console_progress import working
from zoo.guard.conditions import DEGRADED, NOMINAL, WEATHER, Condition, shifted_conditions
from zoo.guard.guard_drives import (
    Fitted,
    GuardResult,
    ObservedDrive,
    ScoredDrive,
    Warnings,
    drive_pairs,
    observe,
    of_group,
    score_drive,
)
from zoo.guard.guard_files import TABLE_COLUMNS, print_result, warnings_table, write_files
from zoo.guard.guard_options import GuardOptions
from zoo.guard.warning_figures import (
    LEADS_S,
    WINDOW_S,
    label_windows,
    warning_figures,
    window_scores,
)
from zoo.monitor.guarded_policy import Guard, write_guard
from zoo.monitor.scores import METHODS, Score, fit_score, fit_threshold
from zoo.monitor.signals import ENSEMBLE, signal_sources
from zoo.verdict.evidence import with_track

GUARD = "guard.pt"
TIMED = 100  # frames whose score is timed


def run_guard(checkpoint: str, options: GuardOptions, console: Console) -> GuardResult:
    """Drive, fit, count and write; return what was found.

    Raises:
        InputError: a checkpoint or track does not exist, an option is wrong, or the network fails
            too often on nominal drives to fit a threshold.
    """
    options.check_files(TABLE_COLUMNS)
    policy = load_policy(checkpoint)
    options = with_track(options, checkpoint, policy.data)
    usual = options.usual()
    named = filter(None, (options.ensemble or "").split(","))
    members = tuple(str(find_checkpoint(one)) for one in named)
    sources, notes = signal_sources(policy, options.samples, [load_policy(one) for one in members])
    if options.method is not None and METHODS[options.method].signal not in sources:
        raise InputError(f"method={options.method}: {'; '.join(notes)}; name another method")
    degraded, count = options.degraded, options.nominal
    if degraded and type(policy) is not CheckpointPolicy:
        notes.append("no degraded networks: needs a checkpoint of one network")
        degraded = 0
    nominal = [
        Condition(NOMINAL, NOMINAL, 0.0, replace(usual, seed=seed))
        for seed in range(1, 3 * count + 1)
    ]
    first = replace(usual, seed=3 * count + 1, laps=options.laps)
    conditions = shifted_conditions(first, options.levels, degraded)
    with command_folder(options.out, "guards") as folder:
        driven = dict(observe(checkpoint, members, nominal, options, NOMINAL, console))
        fitting = [driven[number] for number in range(2 * count)]
        fitted = fit_methods(fitting, options, notes, console)
        if options.method is not None and options.method not in fitted:
            raise InputError(f"method={options.method}: {'; '.join(notes)}; name another method")
        scores = {name: one.score for name, one in fitted.items()}
        what = "weather, light and degraded networks"
        shifted = {
            number: score_drive(drive, conditions[number], scores)
            for number, drive in observe(checkpoint, members, conditions, options, what, console)
        }
        drives = [
            *(
                score_drive(driven[row], nominal[row], scores)
                for row in range(2 * count, 3 * count)
            ),
            *(shifted[number] for number in range(len(conditions))),
        ]
        figures = count_warnings(drives, fitted)
        method = options.method or best_method(figures)
        result = GuardResult(checkpoint, options, fitted, drives, figures, method, notes)
        guard = Guard(
            scores[method],
            fitted[method].threshold.value,
            max(1, round(WINDOW_S * options.frame_rate)),
            options.slow,
            options.samples,
            hash_file(checkpoint),
        )
        path = write_guard(folder / GUARD, guard)
        written = write_files(folder, result)  # kept, if the paired drives are interrupted
        if options.paired:
            result = replace(result, pairs=drive_pairs(result, str(path), usual.speed, console))
            write_files(folder, result)
        print_result(result, console)
        written += options.write_files(warnings_table(result))
        where = [f"track={options.track}", "weather={fog: 0.6}"]
        print_written([path, *written], ["evaluate", checkpoint, f"guard={path}", *where], console)
        return result


def fit_methods(
    drives: list[ObservedDrive], options: GuardOptions, notes: list[str], console: Console
) -> dict[str, Fitted]:
    """Fit scores to the first half of nominal drives, and thresholds to the second half.

    A method that fails adds a note.

    Raises:
        InputError: no method could be fitted.
    """
    half = len(drives) // 2
    fitted: dict[str, Fitted] = {}
    for name, method in METHODS.items():
        if method.signal not in drives[0].signals:
            continue
        with working(f"fitting {name}", console):
            signals = np.concatenate([one.signals[method.signal] for one in drives[:half]])
            score = fit_score(name, signals, options.epochs)
            fits = []
            for one in drives[half:]:
                normal = label_windows(one.drive.time_s, one.drive.intervention).normal
                fits.append(window_scores(score(one.signals[method.signal]), normal))
        try:
            threshold = fit_threshold(np.concatenate(fits), options.false_alarms)
        except InputError as error:
            notes.append(f"not scored: {name}: {error}")
            continue
        fitted[name] = Fitted(score, threshold, _frame_ms(drives[0], score))
    if not fitted:
        raise InputError(notes[-1])
    return fitted


def _frame_ms(drive: ObservedDrive, score: Score) -> float:
    """Return the median processor time of a signal and its score, in milliseconds."""
    method = METHODS[score.method]
    signals = drive.signals[method.signal]
    took_s = []
    for row in range(method.frames, min(len(signals), TIMED) + 1):
        began = time.process_time()
        score(signals[row - method.frames : row])
        took_s.append(time.process_time() - began)
    return drive.signal_ms[method.signal] + 1000 * float(np.median(took_s))


def count_warnings(drives: list[ScoredDrive], fitted: dict[str, Fitted]) -> list[Warnings]:
    """Return figures by group, method and lead; normal windows are those of nominal drives."""
    return [
        Warnings(
            group,
            method,
            lead,
            warning_figures(
                [one.before[method][lead] for one in of_group(drives, group)],
                [one.normal[method] for one in of_group(drives, NOMINAL)],
                fitted[method].threshold.value,
            ),
        )
        for group in (WEATHER, DEGRADED)
        if of_group(drives, group)
        for method in fitted
        for lead in LEADS_S
    ]


def best_method(figures: list[Warnings]) -> str:
    """Return the method with the best mean F3 over weather and leads; the first one if none fails.

    An ensemble is left out, because a guard file holds one checkpoint.
    """
    by_method: dict[str, float] = {}
    for one in figures:
        if one.group == WEATHER and one.method != ENSEMBLE:
            f3 = float(np.nan_to_num(one.figures["f3"].value))
            by_method[one.method] = by_method.get(one.method, 0.0) + f3
    return max(by_method, key=by_method.__getitem__)
