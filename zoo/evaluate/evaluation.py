"""The result of `drivezoo evaluate`: its figures, table and plot, and how it is printed."""

from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.figure import Figure
from rich.console import Console

from simulator.track_names import short_name
from zoo.cli.closing_lines import print_written
from zoo.evaluate.drive_plots import degradation_curves, figures_by_track
from zoo.evaluate.drives_table import DEVIATION, figure_columns, print_drives
from zoo.evaluate.guard_effect import guard_line
from zoo.evaluate.robustness import PERTURBATIONS, sweep_table
from zoo.evaluate.track_scores import how_well
from zoo.runs.table import Column, Table
from zoo.runs.table_files import Result
from zoo.verdict.judgement import Verdict, print_verdict
from zoo.worlds.scenario import Scenario

By = dict[str, dict[float, dict]]


@dataclass(frozen=True, repr=False)
class Evaluation(Result):
    """Drives of a policy in the embedded world.

    Attributes:
        folder: folder with `metrics.json`, and a folder for each drive.
        metrics: contents of `metrics.json`.
        verdict: whether it drives, and what to do next.
        usual: scenario of the first drive.
        swept: figures of the perturbed drives, by perturbation and value.
        problem: what makes the figures invalid, such as steering NaN; empty if nothing does.
        written: further files that the user asked for.
    """

    folder: Path
    metrics: dict
    verdict: Verdict
    usual: Scenario
    swept: By = field(default_factory=dict)
    problem: str = ""
    written: list[Path] = field(default_factory=list)

    @property
    def tracks(self) -> dict[str, dict]:
        """Return by track the mean and sample deviation of each metric."""
        return self.metrics["tracks"]

    @property
    def drives(self) -> list[dict]:
        """Return the figures of each drive."""
        return self.metrics["drives"]

    def __repr__(self) -> str:
        lines = [f"  {name}: {how_well(one)}" for name, one in self.tracks.items()]
        return "\n".join([f"Evaluation in {self.folder}: {self.verdict.headline}", *lines])

    def show(self) -> None:
        """Print the tables, the effect of a guard, what was written and the verdict."""
        console = Console(emoji=False)
        print_drives(self.tracks, console)
        if "guard" in self.metrics:
            line = guard_line(self.metrics["guard"])
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        if self.swept:
            console.print(sweep_table(self.swept, self.usual))
        films = sorted(self.folder.glob("*/film.mp4"))
        print_written([self.folder, *films, *self.written], console=console)
        if not self.problem:
            print_verdict(self.verdict, console)

    def result_table(self) -> Table:
        """Return a row of figures for each track."""
        columns = [Column("track", "track", list(self.tracks)), *figure_columns(self.tracks)]
        name = Path(str(self.metrics["checkpoint"])).name
        caption = f"{name} in the embedded world, {_how(self.usual)}. {DEVIATION}."
        return Table(columns, caption)

    def plot(self) -> Figure:
        """Return a figure of the drives on each track, or of the perturbations' values."""
        if self.swept:
            return curves(self.swept, self.usual)
        return figures_by_track(self.drives)


def curves(swept: By, usual: Scenario) -> Figure:
    """Return the curves of autonomy and error over each perturbation's values."""
    return degradation_curves(
        {PERTURBATIONS[name].label: by_value for name, by_value in swept.items()},
        {PERTURBATIONS[name].label: PERTURBATIONS[name].usual(usual) for name in swept},
        f"{short_name(usual.track)}, {_how(usual)}; dotted: usual",
    )


def _how(usual: Scenario) -> str:
    laps = f"{usual.laps:g} lap{'' if usual.laps == 1 else 's'}"
    if usual.throttle == "network":
        return f"{laps} with its own throttle"
    return f"{laps} at {usual.speed:g} mph"
