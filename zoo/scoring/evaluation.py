"""`drivezoo evaluate`: the drives of a checkpoint, their figures, table and plot."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from rich.console import Console

from zoo.base.command_keys import typed
from zoo.base.new_folder import command_folder
from zoo.base.terminal import counted, print_written
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy, load_policy
from zoo.checkpoints.policy_base import Policy, PolicyFunction
from zoo.driving.drives_table import COUNTS, DEVIATION, figure_columns, nan_line, print_drives
from zoo.driving.metrics import METRICS
from zoo.driving.run_drives import check_throttle
from zoo.driving.scenario import LAPPED, Scenario
from zoo.runs.metrics_file import write_metrics_file
from zoo.runs.plots import save_figure
from zoo.runs.result_table import Column, Table
from zoo.runs.table_files import Result
from zoo.scoring.drive_plots import degradation_curves, figures_by_track
from zoo.scoring.evaluate_options import EvaluateOptions, check_world
from zoo.scoring.evidence import Evidence, other_car_line, read_evidence, with_track
from zoo.scoring.robustness import PERTURBATIONS, perturbations_named, sweep_table, sweeps
from zoo.scoring.track_scores import how_well, score_on_tracks
from zoo.scoring.verdict import KEYS, Verdict, judge, print_verdict
from zoo.scoring.write_up import write_report
from zoo.simulator.track_names import short_name

By = dict[str, dict[float, dict]]
STARTS = "laps", "seeds", "seed", "start", "offset", "heading"


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
        lines = [f"  {name}: {how_well(figures)}" for name, figures in self.tracks.items()]
        return "\n".join([f"Evaluation in {self.folder}: {self.verdict.headline}", *lines])

    def show(self) -> None:
        """Print the tables, what was written and the verdict."""
        console = Console(emoji=False)
        print_drives(self.tracks, console)
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
        caption = f"{name} in the {self.usual.world} world, {_how(self.usual)}. {DEVIATION}"
        return Table(columns, caption)

    def plot(self) -> Figure:
        """Return a figure of the drives on each track, or of the perturbations' values."""
        return curves(self.swept, self.usual) if self.swept else figures_by_track(self.drives)


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
    path = driver if isinstance(driver, str) else None
    policy = load_policy(driver)
    name = path or policy.name
    # Report wrong input before processes start.
    options = with_track(options, name, policy.data)
    ignores = check_world(options)
    check_throttle(policy, options.throttle)
    options.check_files(("track", *COUNTS, *METRICS))
    if options.world == "embedded" and (line := other_car_line(policy.data, options.track)):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    scenarios = options.scenarios
    usual = scenarios[0]
    swept = sweeps(perturbations_named(options.perturb, options.throttle), usual, ignores)
    perturbed = [scenario for by_value in swept.values() for scenario in by_value.values()]
    with command_folder(options.out, "evaluations") as folder:
        scores = score_on_tracks(
            path or policy,
            scenarios,
            folder,
            console,
            options.workers,
            options.played_at,
            perturbed,
            options.executor,
            record=options.record,
        )
        metrics: dict[str, Any] = {"checkpoint": name, "world": options.world}
        metrics |= {} if usual.quality == "full" else {"quality": usual.quality}
        settings = [key for key in (*STARTS, *KEYS) if key not in ignores]
        metrics["settings"] = {key: typed(getattr(options, key)) for key in settings}
        metrics |= {"drives": scores.drives, "tracks": scores.tracks}
        results = {
            name: {value: scores.by_scenario[drive] for value, drive in by_value.items()}
            for name, by_value in swept.items()
        }
        if swept:
            metrics["perturbed"] = {
                name: [{"value": value, **figures} for value, figures in by_value.items()]
                for name, by_value in results.items()
            }
            save_figure(curves(results, usual), folder / "robustness.png")
        evidence = Evidence(None, policy.config)
        if path:
            evidence = read_evidence(path, policy.config, policy.data)
            evidence = replace(evidence, can_train=isinstance(policy, CheckpointPolicy))
        verdict = judge(scores.drives, evidence, options.tracks, options.world, None, vars(options))
        metrics["verdict"] = verdict.plain()
        write_metrics_file(folder, metrics)
        pages = [write_report(folder)] if options.page else []
        nan = nan_line(list(scores.by_scenario.values()))
        problem = f"{name}: {nan}" if nan else ""
        result = Evaluation(folder, metrics, verdict, usual, results, problem, pages)
        result.written.extend(options.write_files(result))
        return result


def curves(swept: By, usual: Scenario) -> Figure:
    """Return the curves of autonomy and error over each perturbation's values."""
    return degradation_curves(
        {PERTURBATIONS[name].label: by_value for name, by_value in swept.items()},
        {PERTURBATIONS[name].label: PERTURBATIONS[name].usual(usual) for name in swept},
        f"{short_name(usual.track)}, {_how(usual)}; dotted: usual",
    )


def _how(usual: Scenario) -> str:
    laps = counted(usual.laps, "lap") if usual.world in LAPPED else "drives"
    held = f"at {usual.speed:g} mph"
    return f"{laps} {'with its own throttle' if usual.throttle == 'network' else held}"
