"""Short drives of the inputs that a recording cannot tell apart."""

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console

from zoo.drives.metrics import cte_mean_m, interventions
from zoo.input_search.judgement import Driven, Judgement
from zoo.input_search.trials import Trial
from zoo.worlds.run_drives import all_drives
from zoo.worlds.scenario import Scenario

# From the bridge to the straight: the bend at the dirt road, and the sharpest bend.
STRETCH = Scenario(track="udacity_lake", start=785.0, laps=0.25, speed=10.0)
MOST_DRIVEN = 4


def drive_tied(
    judged: Judgement, write: Callable[[Trial, Path], None], console: Console
) -> tuple[Driven, ...]:
    """Drive the best input, and return how well; with interventions also those tied with it.

    Of these, the first of each colour and scale come first, which steer least alike.

    Args:
        judged: judgement without drives.
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
    others = list(dict.fromkeys([*groups.values(), *judged.tied]))[: MOST_DRIVEN - 1]
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
