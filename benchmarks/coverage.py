"""How often the interval of the clean drives contains the truth, on simulated entries of suite=v3.

`python benchmarks/coverage.py [COUNT]` prints a Markdown table of COUNT simulated entries a line.
Whether a drive is clean falls with its level by a logistic curve. A place moves the level, and so
does a training: by a normal number, or because it is of the worse of two kinds.
"""

import sys
from collections.abc import Callable

import numpy as np
from scipy import optimize, special

from benchmarks.measuring import markdown_table
from zoo.driving.clustered import SHARE, clustered, p_value

AXES, LEVELS, PLACES = 4, 3, 20
SLOPE, BY_PLACE, BY_TRAINING = 1.5, 0.8, 0.4  # log odds a level; standard deviations, levels
WORSE, WORSE_LEVELS = 0.3, 2.0  # trainings of the worse kind: their share, and what they lose
LEVEL = np.tile(np.repeat(np.arange(1, LEVELS + 1), PLACES), AXES)
AXIS = np.repeat(np.arange(AXES), LEVELS * PLACES)
PLACE = AXIS * PLACES + np.tile(np.arange(PLACES), AXES * LEVELS)
Trainings = Callable[[np.random.Generator, int], np.ndarray]  # levels that each training adds
KINDS: dict[str, Trainings] = {
    "normal": lambda rng, count: BY_TRAINING * rng.normal(size=count),
    "of two kinds": lambda rng, count: -WORSE_LEVELS * (rng.random(count) < WORSE),
}


def draw(
    rng: np.random.Generator, middle: float, trained: np.ndarray, places: np.ndarray
) -> np.ndarray:
    """Return whether the drives of some trainings are clean, bool [training seeds, drives]."""
    level = middle + trained[:, None] + places[PLACE] - LEVEL
    return rng.random(level.shape) < special.expit(SLOPE * level)


def middle_of(share: float, kind: Trainings) -> float:
    """Return the level at which half the drives are clean, for a share of clean drives in all."""
    rng = np.random.default_rng(0)
    moved = kind(rng, 20_000)[:, None] + BY_PLACE * rng.normal(size=(20_000, 1))
    levels = np.arange(1, LEVELS + 1)
    return optimize.brentq(
        lambda middle: special.expit(SLOPE * (middle + moved - levels)).mean() - share, -9, 15
    )


def line(kind: str, seeds: int, share: float, count: int) -> list[str]:
    """Return a line of the table."""
    rng, middle = np.random.default_rng(1), middle_of(share, KINDS[kind])
    inside = above = apart = 0
    places, groups = [str(place) for place in PLACE], [str(axis) for axis in AXIS]
    for _ in range(count):
        moved = BY_PLACE * rng.normal(size=AXES * PLACES)
        a, b = (draw(rng, middle, KINDS[kind](rng, seeds), moved) * 1.0 for _ in range(2))
        failed = clustered(1 - a, places=places, groups=groups, limits=SHARE, one_failure=1.0)
        inside += failed.low <= 1 - share <= failed.high
        above += 1 - failed.high > share
        apart += p_value(a[:, None] - b[None], places, groups) < 0.05
    shares = [f"{hits / count:.1%}" for hits in (inside, above, apart)]
    return [kind, str(seeds), f"{share:.0%}", *shares]


def main(count: int = 1000) -> None:
    """Print the table."""
    head = [
        "trainings",
        "seeds",
        "clean drives",
        "in the interval",
        "interval above",
        "equal told apart",
    ]
    cases = [
        (kind, seeds, share) for kind in KINDS for share in (0.3, 0.6, 0.9) for seeds in (3, 5, 10)
    ]
    print(markdown_table(head, [line(*case, count) for case in cases]))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
