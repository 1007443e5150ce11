"""Short drives of the inputs that a recording cannot tell apart."""

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console

from zoo.driving.metrics import cte_mean_m, interventions
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.extras.keras.combinations import POPULAR
from zoo.extras.keras.judgement import Driven, Judgement, judge
from zoo.extras.keras.trials import Trial

# The two bends before the bridge, the bridge, the bend at the dirt road, and the sharpest bend.
STRETCH = Scenario(track="udacity_lake", start=540.0, laps=0.47, speed=12.0)
MOST_DRIVEN = 4


def drive_tied(
    judged: Judgement, write: Callable[[Trial, Path], None], console: Console
) -> Judgement:
    """Drive the best input, and others if it leaves the lane; return the judgement with drives.

    The others are `POPULAR` and those tied with the best, the first of each colour and scale first,
    which steer least alike. What correlates no better than by chance is not driven.

    Args:
        judged: judgement without drives.
        write: function that writes a trial's checkpoint.
        console: console that shows the progress.

    Raises:
        InputError: a process was killed.
    """
    groups = {
        (tied.combination.view.colour, tied.combination.scale): tied for tied in judged.tied[::-1]
    }
    others = [trial for trial in judged.trials.finalists if trial not in judged.alike]
    popular = [trial for trial in others if trial.combination == POPULAR]
    ordered = dict.fromkeys([judged.best, *popular, *groups.values(), *judged.tied])
    chosen = [trial for trial in ordered if abs(trial.correlation) > judged.chance][:MOST_DRIVEN]
    driven = _drive(chosen[:1], write, console)
    # Of outputs that mean something else, no drive tells which input is right.
    if judged.best.means_steering and not all(drive.kept for drive in driven):
        driven += _drive(chosen[1:], write, console)
    driven.sort(key=lambda lap: (not lap.kept, -round(lap.driven_m, -1), round(lap.cte_mean_m, 1)))
    return judge(judged.trials, tuple(driven), judged)


def _drive(
    trials: Sequence[Trial], write: Callable[[Trial, Path], None], console: Console
) -> list[Driven]:
    """Drive inputs to their first intervention, in parallel; return how well, in their order."""
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{number}.ckpt" for number in range(len(trials))]
        for trial, path in zip(trials, paths, strict=True):
            write(trial, path)
        what = f"driving {len(trials)} of the inputs on {STRETCH.track}"
        names, scenarios = [str(path) for path in paths], [STRETCH] * len(trials)
        shown = {"what": what, "console": console}
        drives = all_drives(names, scenarios, workers=0, first_only=True, **shown)
    return [
        Driven(trial, drive.driven_m, not interventions(drive), cte_mean_m(drive))
        for trial, drive in zip(trials, drives, strict=True)
    ]
