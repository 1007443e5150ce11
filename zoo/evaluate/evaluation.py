"""`drivezoo evaluate`: the drives of a checkpoint, their figures, table and plot."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from simulator.track_names import short_name
from zoo.base.errors import UsageError
from zoo.base.new_folder import command_folder
from zoo.base.terminal import print_written
from zoo.checkpoints.command import Policy, PolicyFunction, as_policy
from zoo.checkpoints.policy import load_policy
from zoo.drives.bootstrap import Estimate, bootstrap
from zoo.drives.drives_table import COUNTS, DEVIATION, figure_columns, nan_line, print_drives
from zoo.drives.metrics import METRICS
from zoo.evaluate.drive_plots import degradation_curves, figures_by_track
from zoo.evaluate.evaluate_options import EvaluateOptions, check_world
from zoo.evaluate.robustness import PERTURBATIONS, perturbations_named, sweep_table, sweeps
from zoo.evaluate.track_scores import how_well, score_on_tracks
from zoo.monitor.guarded_policy import guarded
from zoo.report.write_up import write_report
from zoo.runs.metrics_file import write_metrics_file
from zoo.runs.plots import save_figure
from zoo.runs.table import Column, Table, with_interval
from zoo.runs.table_files import Result
from zoo.verdict.evidence import Evidence, other_car_line, read_evidence, with_track
from zoo.verdict.judgement import Verdict, judge, print_verdict
from zoo.worlds.run_drives import check_throttle
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


def score_driver(
    driver: str | Policy | PolicyFunction, options: EvaluateOptions, console: Console
) -> Evaluation:
    """Score a checkpoint or a policy by driving; write `metrics.json`, drives and plots.

    Args:
        driver: path of a checkpoint, or a policy, which drives in this process.
        options: options of the evaluation.
        console: console for progress and warnings.

    Raises:
        InputError: the checkpoint cannot be loaded, the track does not exist, or an option is
            wrong.
    """
    is_file = isinstance(driver, str)
    policy = load_policy(driver) if is_file else as_policy(driver)
    name = driver if is_file else policy.name
    # Report wrong input before processes start.
    options = with_track(options, name, policy.data)
    check_world(options)
    check_throttle(policy, options.throttle)
    options.check_files(("track", *COUNTS, *METRICS))
    if options.guard and not is_file:
        raise UsageError(f"guard={options.guard}: belongs to a checkpoint; name its path")
    if options.guard:
        guarded(policy, driver, options.guard)
    if options.world == "embedded" and (line := other_car_line(policy.data, options.track)):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    names = perturbations_named(options.perturb, options.throttle)
    scenarios = options.scenarios
    usual = scenarios[0]
    swept = sweeps(names, usual)
    unguarded = [replace(drive, guard=None) for drive in scenarios if drive.guard]
    more = [scenario for by_value in swept.values() for scenario in by_value.values()]
    with command_folder(options.out, "evaluations") as folder:
        scores = score_on_tracks(
            driver if is_file else policy,
            scenarios,
            folder,
            console,
            options.workers,
            options.played_at,
            more + unguarded,
            options.executor,
            record=options.record,
        )
        metrics = {"checkpoint": name, "world": options.world}
        metrics |= {"drives": scores.drives, "tracks": scores.tracks}
        if options.guard:
            without = [scores.by_scenario[drive] for drive in unguarded]
            metrics["guard"] = guard_effect(options.guard, scores.drives, without)
        results = {
            name: {value: scores.by_scenario[drive] for value, drive in by_value.items()}
            for name, by_value in swept.items()
        }
        if names:
            metrics["perturbed"] = {
                name: [{"value": value, **figures} for value, figures in by_value.items()]
                for name, by_value in results.items()
            }
            save_figure(curves(results, usual), folder / "robustness.png")
        evidence = Evidence(None, policy.config)
        if is_file:
            evidence = read_evidence(driver, policy.config, policy.data)
        verdict = judge(scores.drives, evidence, options.tracks, options.world)
        metrics["verdict"] = verdict.plain()
        write_metrics_file(folder, metrics)
        pages = [write_report(folder)] if options.page else []
        nan = nan_line(list(scores.by_scenario.values()))
        problem = f"{name}: {nan}" if nan else ""
        result = Evaluation(folder, metrics, verdict, usual, results, problem, pages)
        result.written.extend(options.write_files(result))
        return result


def guard_effect(guard: str, guarded: Sequence[dict], without: Sequence[dict]) -> dict:
    """Return the effect of a guard.

    Args:
        guard: path of the guard file.
        guarded: figures of the drives with the guard.
        without: figures of the same drives without it.

    Returns:
        Alarms, interventions and mean speed with and without the guard, and the interventions that
        it prevented per drive, with a 95 % interval over three tracks or more.
    """
    lost, lost_without = (
        np.array([drive["interventions"] for drive in drives], float)
        for drives in (guarded, without)
    )
    tracks = np.array([drive["track"] for drive in guarded])
    by_track = [(lost_without - lost)[tracks == one].mean() for one in dict.fromkeys(tracks)]
    return {
        "guard": guard,
        "alarms": sum(drive["guard_alarms"] for drive in guarded),
        "interventions": int(lost.sum()),
        "interventions_without": int(lost_without.sum()),
        "prevented_per_drive": asdict(bootstrap(np.array(by_track))),
        "speed_mph": float(np.mean([drive["speed_mph"] for drive in guarded])),
        "speed_mph_without": float(np.mean([drive["speed_mph"] for drive in without])),
    }


def guard_line(effect: dict) -> str:
    """Return a sentence about the effect of a guard."""
    prevented = with_interval(Estimate(**effect["prevented_per_drive"]), "{:.2f}")
    return (
        f"guard: {effect['alarms']} alarms; interventions {effect['interventions']} with it, "
        f"{effect['interventions_without']} without it; prevented per drive: {prevented}; mean "
        f"speed {effect['speed_mph']:.1f} instead of {effect['speed_mph_without']:.1f} mph"
    )


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
