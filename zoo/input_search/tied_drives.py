"""Short drives of the inputs that a recording cannot tell apart."""

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console

from zoo.drives.metrics import cte_mean_m, interventions
from zoo.input_search.combinations import POPULAR
from zoo.input_search.judgement import Driven, Judgement
from zoo.input_search.trials import Trial, Trials
from zoo.worlds.run_drives import all_drives
from zoo.worlds.scenario import Scenario

# The two bends before the bridge, the bridge, the bend at the dirt road, and the sharpest bend.
STRETCH = Scenario(track="udacity_lake", start=540.0, laps=0.47, speed=12.0)
MOST_DRIVEN = 4


def drive_tied(
    judged: Judgement,
    trials: Trials,
    write: Callable[[Trial, Path], None],
    console: Console,
) -> tuple[Driven, ...]:
    """Drive the best input, and return how well; with interventions also others.

    These are `POPULAR` and those tied with it, the first of each colour and scale first, which
    steer least alike.

    Args:
        judged: judgement without drives.
        trials: trials that were judged.
        write: function that writes a trial's checkpoint.
        console: console that shows the progress.

    Returns:
        What drove, the best first.

    Raises:
        InputError: a process was killed.
    """
    groups = {
        (one.combination.view.colour, one.combination.scale): one for one in judged.tied[::-1]
    }
    known = [judged.best, *judged.alike]
    popular = [one for one in trials.finalists if one.combination == POPULAR and one not in known]
    others = list(dict.fromkeys([*popular, *groups.values(), *judged.tied]))[: MOST_DRIVEN - 1]
    driven = _drive([judged.best], write, console)
    if driven[0].interventions:
        driven += _drive(others, write, console)
    return tuple(sorted(driven, key=lambda one: (one.interventions, round(one.cte_mean_m, 1))))


def _drive(
    trials: Sequence[Trial], write: Callable[[Trial, Path], None], console: Console
) -> list[Driven]:
    """Drive inputs, in parallel, and return how well, in their order."""
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{number}.ckpt" for number in range(len(trials))]
        for trial, path in zip(trials, paths, strict=True):
            write(trial, path)
        what = f"driving {len(trials)} of the inputs on {STRETCH.track}"
        names, scenarios = [str(path) for path in paths], [STRETCH] * len(trials)
        drives = all_drives(names, scenarios, workers=0, what=what, console=console)
    return [
        Driven(trial, interventions(one), cte_mean_m(one))
        for trial, one in zip(trials, drives, strict=True)
    ]
