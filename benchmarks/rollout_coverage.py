"""How often the intervals of `drivezoo compare` contain the truth, on simulated successes.

`python -m benchmarks.rollout_coverage [COUNT]` prints a Markdown table of COUNT simulated pairs of
policies a line: 10 rollouts in each of 10 scenes. A scene moves the log odds of both policies, and
more of each. The interval of Wilson (1927) takes all rollouts for independent.
"""

import sys

import numpy as np
from scipy import special

from benchmarks.measuring import markdown_table
from zoo.extras.research.rollout_differences import NEW, THESE, compare_policies, mean_score
from zoo.extras.research.rollouts import Rollout

SCENES, SEEDS = 10, 10
NORMAL = float(special.ndtri(0.975))
SPREADS = {"alike": 0.0, "differ": 1.0}  # standard deviation of the scenes, log odds
SHARES = (0.5, 0.8, 0.95)


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Return the interval of Wilson 1927, "Probable inference"."""
    share, square = successes / trials, NORMAL**2 / trials
    middle = (share + square / 2) / (1 + square)
    half = np.sqrt(share * (1 - share) / trials + square / trials / 4) * NORMAL / (1 + square)
    return middle - half, middle + half


def rollouts(policy: str, won: np.ndarray, seeds: bool = True) -> list[Rollout]:
    """Return successes [scenes, seeds] as rollouts."""
    return [
        Rollout(policy, float(won[scene, seed]), f"scene {scene}", str(seed) if seeds else "")
        for scene, seed in np.ndindex(*won.shape)
    ]


def line(kind: str, share: float, count: int) -> list[str]:
    """Return a line of the table: the share of intervals that contain the truth."""
    rng, spread = np.random.default_rng(1), SPREADS[kind]
    many = spread * rng.normal(size=100_000)
    middle = special.logit(share) * np.sqrt(1 + 0.346 * spread**2)  # as logistic means shrink
    true = float(special.expit(middle + many).mean())
    hits = np.zeros(5)
    for _ in range(count):
        scenes = spread * rng.normal(size=(SCENES, 1))
        own = spread / 2 * rng.normal(size=(2, SCENES, 1))
        odds = special.expit(middle + np.sqrt(0.75) * scenes + own)
        a, b = rng.random((2, SCENES, SEEDS)) < odds
        of_scenes = float(odds[0].mean())
        policies = {"a": rollouts("a", a), "b": rollouts("b", b)}
        these, new = (mean_score(policies["a"], scope) for scope in (THESE, NEW))
        difference_these, difference_new = compare_policies(policies)
        bounds = (
            (of_scenes, these.low, these.high),
            (true, new.low, new.high),
            (true, *wilson(int(a.sum()), a.size)),
            (odds[0].mean() - odds[1].mean(), *_bounds(difference_these.figure)),
            (0.0, *_bounds(difference_new.figure)),
        )
        hits += [low <= value <= high for value, low, high in bounds]
    return [kind, f"{true:.0%}", *(f"{share:.1%}" for share in hits / count)]


def _bounds(figure: object) -> tuple[float, float]:
    return figure.low, figure.high  # type: ignore[attr-defined]


def main(count: int = 1000) -> None:
    """Print the table."""
    head = [
        *("scenes", "success", "these scenes", "new scenes", "Wilson, new scenes"),
        *("difference, these scenes", "difference, new scenes"),
    ]
    cases = [(kind, share) for kind in SPREADS for share in SHARES]
    print(markdown_table(head, [line(*case, count) for case in cases]))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
