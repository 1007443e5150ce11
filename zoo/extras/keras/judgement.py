"""Judgement of a search: whether a network saw its best combination, and which others may be right.

Correlations of outputs that have nothing to do with the steering are measured by rolling the
recorded steering along the recording, which keeps how it changes with time. For each shift, the
highest correlation of all combinations counts, since the search takes the highest, too.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from datamodules.view import RESIZES
from zoo.extras.keras.combinations import POPULAR, SCALES, KnownInput, TrialFrames
from zoo.extras.keras.trials import (
    MOST_TIED,
    Network,
    Trial,
    Trials,
    correlations,
    planned_images,
    try_all,
    try_inputs,
)

NULL_SHARE = 0.99
LEAST_CORRELATION = 0.5  # the output explains a quarter of the steering's variance
SURE = 0.95
RESAMPLES = 200
BLOCKS = 30  # neighbouring frames are alike
SAME_STEERING = 0.02  # mean difference of two outputs that makes no difference in driving


@dataclass(frozen=True)
class Driven:
    """A trial's input that drove a stretch of `udacity_lake`.

    Attributes:
        trial: its trial.
        driven_m: metres to its first intervention, or to the end.
        kept: whether it reached the end without an intervention.
        cte_mean_m: mean distance from the centreline, m.
    """

    trial: Trial
    driven_m: float
    kept: bool
    cte_mean_m: float


@dataclass(frozen=True)
class Judgement:
    """A judgement of the best trial.

    Attributes:
        best: trial that drove best, or the one with the highest score; of those that steer like
            it, the most usual one.
        doubts: reasons why the network may have seen something else than the best combination.
        chance: correlation that steering which is rolled along the recording exceeds in 1 %.
        alike: other finalists that steer the same as the best.
        tied: finalists that steer differently, but whose score may be as high as the best's.
        next: best finalist that is certainly different in score; None without one.
        trials: all trials.
        driven: how well the best and the tied ones drove, the best first; empty if they did not.
    """

    best: Trial
    doubts: tuple[str, ...]
    chance: float
    alike: tuple[Trial, ...]
    tied: tuple[Trial, ...]
    next: Trial | None
    trials: Trials
    driven: tuple[Driven, ...] = ()


def search(
    network: Network,
    facts: KnownInput,
    frames: TrialFrames,
    show: Callable[[float], None] = lambda share: None,
    show_best: Callable[[Trial], None] = lambda trial: None,
) -> Judgement:
    """Try inputs on some of the frames, and on all of them only what these cannot tell apart.

    Args:
        network: see `try_inputs`, as for all of these.
        facts: facts about the input.
        frames: frames to try on.
        show: function called with the finished share of the work, 0..1.
        show_best: function called with the best trial of each stage.

    Raises:
        InputError: no combination fits.
    """
    planned, seen = planned_images(facts, frames), [0]

    def did(images: int) -> None:  # from several threads
        seen.append(images)
        show(min(sum(seen) / planned, 1.0))

    trials = try_inputs(network, facts, frames, did, show_best)
    judged = judge(trials)
    if not judged.tied or len(judged.best.steering) == len(frames.steering):
        show(1.0)
        return judged
    near = [judged.best, *judged.tied[:MOST_TIED], *([judged.next] if judged.next else [])]
    chosen = [trial.combination for trial in near]
    if any(trial.combination == POPULAR for trial in trials.finalists):
        chosen.append(POPULAR)
    again = try_all(network, list(dict.fromkeys(chosen)), frames, did)
    show(1.0)
    show_best(again[0])
    return judge(replace(trials, finalists=tuple(again)), before=judged)


def judge(
    trials: Trials, driven: tuple[Driven, ...] = (), before: Judgement | None = None
) -> Judgement:
    """Return the judgement of a search.

    Args:
        trials: trials of the search.
        driven: drives of some of them, the best first.
        before: judgement on fewer frames or without drives; what steers like the best input there
            is not tried again.
    """
    chance = chance_correlation(trials)
    first = driven[0].trial if driven else trials.finalists[0]
    alike = [finalist for finalist in trials.finalists if steer_alike(first, finalist)]
    colour, crop = first.combination.view.colour, first.combination.view.crop
    views = [(trial, trial.combination.view) for trial in alike]
    usual = [trial for trial, view in views if (view.colour, view.crop) == (colour, crop)]
    best = min(usual, key=_rarity)
    if before and before.best.combination == best.combination:
        alike += before.alike
    different = [finalist for finalist in trials.finalists if finalist not in alike]
    samples = _resamples(best)
    scores = _scores(best, samples)
    tied = [trial for trial in different if _low(scores - _scores(trial, samples)) <= 0]
    return Judgement(
        best,
        tuple(_doubts(best, chance, samples)),
        chance,
        tuple(dict.fromkeys(trial for trial in alike if trial is not best)),
        tuple(tied),
        next((trial for trial in different if trial not in tied), None),
        trials,
        driven,
    )


def chance_correlation(trials: Trials) -> float:
    """Return the correlation that all combinations reach by chance in 1 % of the shifts."""
    steering = trials.coarse[0].steering
    outputs = np.stack([trial.cameras[0] for trial in trials.coarse])
    rows = len(steering)
    shifts = range(rows // 20, rows - rows // 20 + 1)
    highest = [np.abs(correlations(outputs, np.roll(steering, shift))).max() for shift in shifts]
    return float(np.quantile(highest, NULL_SHARE))


def _doubts(best: Trial, chance: float, samples: list[np.ndarray]) -> list[str]:
    doubts = []
    if abs(best.correlation) <= chance:
        doubts.append(
            f"its correlation with the recorded steering, {best.correlation:.2f}, is not above "
            f"{chance:.2f}, which one of {len(best.steering):,} frames can reach by chance"
        )
    elif abs(best.correlation) < LEAST_CORRELATION:
        doubts.append(
            f"its correlation with the recorded steering, {best.correlation:.2f}, is below "
            f"{LEAST_CORRELATION:g}; it is also so low with a wrong colour or crop"
        )
    if not best.means_steering:
        spread = best.cameras[0].std() / best.steering.std()
        doubts.append(
            f"its output is not like steering: its spread is {spread:.2g} times the recorded one, "
            f"its mean {best.cameras[0].mean():.2g}"
        )
    sign = np.sign(best.correlation)
    if (
        len(best.cameras) > 1
        and _low(np.array([sign * best.rows(rows).recovery for rows in samples])) <= 0
    ):
        doubts.append(f"its recovery response, {best.recovery:+.3f}, is not surely above 0")
    return doubts


def _rarity(trial: Trial) -> tuple[int, int]:
    """Return the places of a trial's resize and scale among the usual ones, 0 for the first."""
    resizes, scale = list(RESIZES), trial.combination.scale
    rank = SCALES.index(scale) if scale in SCALES else len(SCALES)
    return resizes.index(trial.combination.view.resize), rank


def steer_alike(first: Trial, other: Trial) -> bool:
    """Return whether two trials' outputs differ too little to matter in driving."""
    return bool(np.abs(first.outputs - other.outputs).mean() < SAME_STEERING)


def _scores(trial: Trial, samples: list[np.ndarray]) -> np.ndarray:
    return np.array([trial.rows(rows).score for rows in samples])


def _low(values: np.ndarray) -> float:
    """Return the lower end of the interval that holds 95 % of the values."""
    return float(np.quantile(values, (1 - SURE) / 2))


def _resamples(trial: Trial) -> list[np.ndarray]:
    """Return the rows of each bootstrap resample, drawn in blocks, int64 [N] each."""
    rows = len(trial.steering)
    blocks = np.array_split(np.arange(rows), min(rows, BLOCKS))
    draws = np.random.default_rng(0).integers(len(blocks), size=(RESAMPLES, len(blocks)))
    return [np.concatenate([blocks[block] for block in draw]) for draw in draws]
