"""The guard command from its options to its files."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

from zoo.base.errors import InputError
from zoo.base.new_folder import command_folder
from zoo.base.regular_file import hash_file
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.checkpoints.policy import CheckpointPolicy, load_policy
from zoo.cli.closing_lines import print_written
from zoo.cli.console_progress import working
from zoo.drives.bootstrap import Estimate
from zoo.guard.conditions import DEGRADED, WEATHER, Condition, shifted_conditions
from zoo.guard.guard_drives import Driven, Fleet, ObservedDrive, ScoredDrive, score_drive
from zoo.guard.guard_files import print_result, write_files
from zoo.guard.guard_options import GuardOptions
from zoo.guard.guard_result import NOMINAL, Fitted, GuardResult, Pairs, of_group
from zoo.guard.guard_tables import TABLE_COLUMNS, warnings_table
from zoo.guard.labelled_windows import LEADS_S, WINDOW_S
from zoo.guard.warning_figures import warning_figures
from zoo.monitor.guard_file import Guard, write_guard
from zoo.monitor.scores import METHODS, Score, Threshold, fit_score, fit_threshold
from zoo.monitor.signals import ENSEMBLE, signal_sources
from zoo.worlds.scenario import Scenario

GUARD = "guard.pt"
TIMED = 100  # frames whose score is timed


def run_guard(checkpoint: str, options: GuardOptions, console: Console) -> GuardResult:
    """Drive, fit, count and write; return what was found.

    Raises:
        InputError: a checkpoint or track does not exist, an option is wrong, or the network fails
            too often on nominal drives to fit a threshold.
    """
    options.check_files(TABLE_COLUMNS)
    usual = options.usual()
    members = tuple(str(find_checkpoint(one)) for one in options.members)
    policy = load_policy(checkpoint)
    sources, notes = signal_sources(policy, options.samples, [load_policy(one) for one in members])
    if options.method is not None and METHODS[options.method].signal not in sources:
        raise InputError(f"method={options.method}: {'; '.join(notes)}; name another method")
    degraded = options.degraded
    if degraded and type(policy) is not CheckpointPolicy:
        notes.append("no degraded networks: needs a checkpoint of one network")
        degraded = 0
    with command_folder(options.out, "guards") as folder:
        fleet = Fleet(checkpoint, members, options.samples, options.workers, console)
        fitted = fit_nominal(fleet, options, usual, notes)
        if options.method is not None and options.method not in fitted.scores:
            raise InputError(f"method={options.method}: {'; '.join(notes)}; name another method")
        conditions = shifted_conditions(
            replace(usual, seed=3 * options.nominal + 1, laps=options.laps),
            options.levels,
            degraded,
        )
        shifted = drive_shifted(fleet, conditions, fitted)
        figures = count_warnings(shifted, fitted)
        method = options.method or best_method(figures)
        guard = Guard(
            fitted.scores[method],
            fitted.thresholds[method].value,
            max(1, round(WINDOW_S * options.frame_rate)),
            options.slow,
            options.samples,
            hash_file(checkpoint),
        )
        path = write_guard(folder / GUARD, guard)
        result = GuardResult(
            checkpoint,
            options,
            fitted,
            shifted,
            figures,
            alarms_in_shift(shifted, fitted),
            method,
            notes=notes,
        )
        written = write_files(folder, result)  # kept, if the paired drives are interrupted
        if options.paired:
            result = replace(result, pairs=drive_paired(fleet, path, result, usual))
            write_files(folder, result)
        print_result(result, console)
        written += options.write_files(warnings_table(result))
        following = ["evaluate", checkpoint, f"guard={path}", "weather={fog: 0.6}"]
        print_written([path, *written], following, console)
        return result


def fit_nominal(fleet: Fleet, options: GuardOptions, usual: Scenario, notes: list[str]) -> Fitted:
    """Drive nominal drives, and fit scores and thresholds; a method that fails adds a note.

    Raises:
        InputError: no method could be fitted.
    """
    count = options.nominal
    nominal = [
        Condition(NOMINAL, NOMINAL, 0.0, replace(usual, seed=seed))
        for seed in range(1, 3 * count + 1)
    ]
    drives: dict[int, ObservedDrive] = {}
    fleet.observe(nominal, NOMINAL, drives.__setitem__)
    train = [drives[number] for number in range(count)]
    scores: dict[str, Score] = {}
    thresholds: dict[str, Threshold] = {}
    for name, method in METHODS.items():
        if method.signal not in train[0].signals:
            continue
        with working(f"fitting {name}", fleet.console):
            signals = np.concatenate([one.signals[method.signal] for one in train])
            score = fit_score(name, signals, options.epochs)
            fits = [
                score_drive(drives[number], None, 0, {name: score}).normal[name]
                for number in range(count, 2 * count)
            ]
        try:
            thresholds[name] = fit_threshold(np.concatenate(fits), options.false_alarms)
        except InputError as error:
            notes.append(f"not scored: {name}: {error}")
            continue
        scores[name] = score
    if not scores:
        raise InputError(notes[-1])
    held_out = range(2 * count, 3 * count)
    return Fitted(
        scores,
        thresholds,
        {name: _frame_ms(drives[0], score) for name, score in scores.items()},
        [score_drive(drives[one], nominal[one], one + 1, scores) for one in held_out],
    )


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


def drive_shifted(fleet: Fleet, conditions: list[Condition], fitted: Fitted) -> list[ScoredDrive]:
    """Drive the conditions and return their scores."""
    found: dict[int, ScoredDrive] = {}

    def take(number: int, drive: ObservedDrive) -> None:
        one = conditions[number]
        found[number] = score_drive(drive, one, one.scenario.seed, fitted.scores)

    fleet.observe(conditions, "weather, light and degraded networks", take)
    return [found[number] for number in range(len(conditions))]


def count_warnings(
    shifted: list[ScoredDrive], fitted: Fitted
) -> dict[str, dict[str, dict[int, dict[str, Estimate]]]]:
    """Return the figures by group, method and lead; normal windows are those of nominal drives."""
    return {
        group: {
            method: {
                lead: warning_figures(
                    [one.before[method][lead] for one in of_group(shifted, group)],
                    [one.normal[method] for one in fitted.nominal],
                    fitted.thresholds[method].value,
                )
                for lead in LEADS_S
            }
            for method in fitted.scores
        }
        for group in (WEATHER, DEGRADED)
        if of_group(shifted, group)
    }


def alarms_in_shift(shifted: list[ScoredDrive], fitted: Fitted) -> dict[str, dict[str, float]]:
    """Return the share of alarms in windows of the conditions that no failure follows."""
    found: dict[str, dict[str, float]] = {}
    for group in (WEATHER, DEGRADED):
        for method, threshold in fitted.thresholds.items():
            normal = [one.normal[method] for one in of_group(shifted, group)]
            scores = np.concatenate([np.zeros(0), *normal])
            share = float((scores > threshold.value).mean()) if len(scores) else float("nan")
            found.setdefault(group, {})[method] = share
    return found


def best_method(figures: dict[str, dict[str, dict[int, dict[str, Estimate]]]]) -> str:
    """Return the method with the best mean F3 over weather and leads; the first one if none fails.

    An ensemble is left out, because a guard file holds one checkpoint.
    """
    by_method = {name: one for name, one in figures[WEATHER].items() if name != ENSEMBLE}

    def mean_f3(name: str) -> float:
        found = [one["f3"].value for one in by_method[name].values()]
        return float(np.mean(np.nan_to_num(found)))

    return max(by_method, key=mean_f3)


def drive_paired(fleet: Fleet, guard: Path, result: GuardResult, usual: Scenario) -> Pairs:
    """Drive the conditions and the held-out nominal drives again, with the guard and slower."""
    drives = [*result.fitted.nominal, *result.shifted]
    conditions = [one.condition for one in drives]
    without = [Driven(one.windows.failures, one.driven_m, usual.speed) for one in drives]
    return Pairs(conditions, without, *fleet.drive_pairs(str(guard), conditions))
