"""Score of a checkpoint or a policy by drives in the embedded world."""

from rich.console import Console

from zoo.base.errors import UsageError
from zoo.checkpoints.checkpoint_path import find_driver
from zoo.checkpoints.command import Policy, PolicyFunction
from zoo.cli.console_progress import loading
from zoo.evaluate.evaluate_options import EvaluateOptions
from zoo.evaluate.evaluation import Evaluation


def score_driver(
    checkpoint: str | Policy | PolicyFunction, options: EvaluateOptions, console: Console
) -> Evaluation:
    """Score a checkpoint or a policy by driving; write `metrics.json`, drives and plots.

    Args:
        checkpoint: path as users name it, or a policy, which drives in this process.
        options: options of the evaluation.
        console: console for progress and warnings.

    Raises:
        InputError: the checkpoint or track does not exist, or an option is wrong.
    """
    checkpoint = find_driver(checkpoint)  # reports a wrong path before torch is imported
    with loading():
        from zoo.base.new_folder import command_folder
        from zoo.checkpoints.command import as_policy
        from zoo.checkpoints.policy import load_policy
        from zoo.drives.metrics import METRICS
        from zoo.evaluate.drives_table import COUNTS, nan_line
        from zoo.evaluate.evaluate_options import check_world
        from zoo.evaluate.evaluation import curves
        from zoo.evaluate.guard_effect import guard_effect, unguarded
        from zoo.evaluate.robustness import perturbations_named, sweeps
        from zoo.evaluate.track_scores import score_on_tracks
        from zoo.monitor.guarded_policy import guarded
        from zoo.runs.metrics_file import write_metrics_file
        from zoo.runs.plots import save_figure
        from zoo.runs.table_files import check_plot, check_table, write_asked
        from zoo.verdict.evidence import Evidence, read_evidence
        from zoo.verdict.judgement import judge
        from zoo.worlds.run_drives import check_throttle

        # Report wrong input before processes start.
        is_file = isinstance(checkpoint, str)
        policy = load_policy(checkpoint) if is_file else as_policy(checkpoint)
        check_world(options)
        check_throttle(policy, options.throttle)
        check_table(options.table, options.columns, ("track", *COUNTS, *METRICS))
        check_plot(options.plot)
        if options.guard and not is_file:
            raise UsageError(f"guard={options.guard}: belongs to a checkpoint; name its path")
        if options.guard:
            guarded(policy, checkpoint, options.guard)
    names = perturbations_named(options.perturb, options.throttle)
    scenarios = options.scenarios
    usual = scenarios[0]
    swept = sweeps(names, usual)
    with command_folder(options.out, "evaluations") as folder:
        more = [one for by_value in swept.values() for one in by_value.values()]
        more += unguarded(scenarios)
        scores = score_on_tracks(
            checkpoint if is_file else policy,
            scenarios,
            folder,
            console,
            options.workers,
            options.played_at,
            more,
            options.executor,
        )
        name = checkpoint if is_file else policy.name
        metrics = {"checkpoint": name, "drives": scores.drives, "tracks": scores.tracks}
        if options.guard:
            without = [scores.by_scenario[one] for one in unguarded(scenarios)]
            metrics["guard"] = guard_effect(options.guard, scores.drives, without)
        results = {
            name: {value: scores.by_scenario[one] for value, one in by_value.items()}
            for name, by_value in swept.items()
        }
        if names:
            metrics["perturbed"] = {
                name: [{"value": value, **one} for value, one in by_value.items()]
                for name, by_value in results.items()
            }
            save_figure(curves(results, usual), folder / "robustness.png")
        evidence = Evidence(None, policy.config)
        if is_file:
            evidence = read_evidence(checkpoint, policy.config, policy.data)
        verdict = judge(scores.drives, evidence, options.tracks, options.world)
        metrics["verdict"] = verdict.plain()
        write_metrics_file(folder, metrics)
        nan = nan_line(list(scores.by_scenario.values()))
        problem = f"{name}: {nan}" if nan else ""
        result = Evaluation(folder, metrics, verdict, usual, results, problem)
        result.written.extend(write_asked(result, options.table, options.plot, options.columns))
        return result
