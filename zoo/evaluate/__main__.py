"""`python -m zoo.evaluate CKPT [key=value ...]`: score a checkpoint by driving.

Drives it in the embedded world, with several drives in parallel and without a display, and writes
figures, drives and plots.
"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from datamodules.errors import InputError, UsageError
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.cli.closing_lines import print_written
from zoo.cli.command import CHECKPOINT, Command
from zoo.cli.console_progress import loading
from zoo.cli.run_command import run_command

if TYPE_CHECKING:
    from zoo.evaluate.evaluate_options import EvaluateOptions
    from zoo.evaluate.many_drives import Setup

COMMAND = Command(__doc__, {"CKPT": CHECKPOINT})

# Slow imports (torch, Panda3D) come late: --help and typos answer at once.


def evaluate(checkpoint: str, options: "EvaluateOptions", console: Console) -> dict:
    """Score a checkpoint by driving, write `metrics.json`, drives and plots; return the metrics.

    Raises:
        InputError: the checkpoint or track does not exist, or an option is wrong; or the network
            steered NaN, after all files are written.
    """
    checkpoint = str(find_checkpoint(checkpoint))  # reports a wrong path before torch is imported
    with loading():
        from zoo.checkpoints.policy import load_policy
        from zoo.evaluate.drives_table import drives_table, nan_line
        from zoo.evaluate.evaluate_options import check_world
        from zoo.evaluate.guard_effect import guard_effect, guard_line, unguarded
        from zoo.evaluate.many_drives import Setup, check_throttle
        from zoo.evaluate.robustness import perturbations_named, sweeps
        from zoo.evaluate.track_scores import score_on_tracks
        from zoo.monitor.guarded_policy import guarded
        from zoo.runs.metrics_file import write_metrics_file
        from zoo.runs.new_folder import new_folder
        from zoo.verdict.evidence import read_evidence
        from zoo.verdict.judgement import judge, print_verdict

        # Report wrong input before processes start.
        policy = load_policy(checkpoint)
        check_world(options)
        check_throttle(policy, options.throttle)
        if options.guard:
            guarded(policy, checkpoint, options.guard)
    names = perturbations_named(options.perturb, options.throttle)
    usual = Setup.of(options, options.tracks[0], 0)
    swept = sweeps(names, usual)
    folder = new_folder(options.out, "evaluations")
    more = [one for by_value in swept.values() for one in by_value.values()]
    more += unguarded(options)
    scores = score_on_tracks(checkpoint, options, folder, console, more)
    metrics = {"checkpoint": str(checkpoint), "drives": scores.drives, "tracks": scores.tracks}
    console.print(drives_table(scores.tracks))
    if options.guard:
        without = [scores.by_setup[one] for one in unguarded(options)]
        metrics["guard"] = guard_effect(options.guard, scores.drives, without)
        line = guard_line(metrics["guard"])
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    if names:
        results = {
            name: {value: scores.by_setup[one] for value, one in by_value.items()}
            for name, by_value in swept.items()
        }
        metrics["perturbed"] = {
            name: [{"value": value, **one} for value, one in by_value.items()]
            for name, by_value in results.items()
        }
        _show_sweeps(results, usual, folder, console)
    verdict = judge(scores.drives, read_evidence(checkpoint, policy.config))
    metrics["verdict"] = verdict.plain()
    write_metrics_file(folder, metrics)
    print_written([folder], console=console)
    if nan := nan_line(list(scores.by_setup.values())):
        raise InputError(f"{checkpoint}: {nan}")
    print_verdict(verdict, console)
    return metrics


def _show_sweeps(results: dict, usual: "Setup", folder: Path, console: Console) -> None:
    from simulator.track_names import short_name
    from zoo.evaluate.drive_plots import degradation_curves
    from zoo.evaluate.robustness import PERTURBATIONS, sweep_table
    from zoo.runs.plots import save_figure

    console.print(sweep_table(results, usual))
    figure = degradation_curves(
        {PERTURBATIONS[name].label: by_value for name, by_value in results.items()},
        {PERTURBATIONS[name].label: PERTURBATIONS[name].usual(usual) for name in results},
        f"{short_name(usual.track)}, {_how(usual)}; dotted: usual",
    )
    save_figure(figure, folder / "robustness.png")


def _how(usual: "Setup") -> str:
    laps = f"{usual.laps:g} lap{'' if usual.laps == 1 else 's'}"
    if usual.throttle == "network":
        return f"{laps} with its own throttle"
    return f"{laps} at {usual.speed_mph:g} mph"


def command(arguments: list[str]) -> None:
    """Read the arguments and evaluate, in the embedded world or on a recording."""
    (checkpoint,), rest = COMMAND.split(arguments)
    others = [one for one in rest if not one.startswith(("replay=", "evaluate.replay="))]
    console = Console(emoji=False)
    from zoo.cli.command_config import read_options

    if len(others) == len(rest):
        from zoo.evaluate.evaluate_options import EvaluateOptions

        evaluate(checkpoint, read_options(COMMAND.name, EvaluateOptions, rest), console)
        return
    from zoo.evaluate.replay_score import ReplayOptions, replay_recording

    recordings = [one.partition("=")[2] for one in rest if one not in others]
    if len(recordings) > 1:
        raise UsageError("replay: given twice; give it once")
    options = read_options("replay", ReplayOptions, others)
    replay_recording(checkpoint, recordings[0], options, console)


if __name__ == "__main__":
    sys.exit(run_command("zoo.evaluate", command, sys.argv[1:]))
