"""`python -m zoo.evaluate CKPT [track=lake,mountain seeds=3]`: score a checkpoint by driving.

Drives it in the embedded world, several drives in parallel, without a simulator or a display.
"""

import datetime
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from datamodules.errors import InputError
from zoo.command_line import run_command

if TYPE_CHECKING:
    from zoo.scoring.drives import Setup
    from zoo.scoring.options import EvaluateOptions

USAGE = "python -m zoo.evaluate RUN_FOLDER/checkpoints/best.ckpt [key=value...]"

# torch and Panda3D take seconds to import; --help and a typo need neither.


def evaluate(checkpoint: str, options: "EvaluateOptions", console: Console) -> dict:
    """Drive as `EvaluateOptions` say, print the table, and write `metrics.json`, drives and plots;
    returns the metrics.

    Raises:
        InputError: no such checkpoint or track, an option that cannot be.
    """
    from zoo.checkpoint import load_checkpoint
    from zoo.scoring.drives import Setup, drive_all, expert_steering_per_s
    from zoo.scoring.options import check_options
    from zoo.scoring.robustness import perturbations_named, sweeps
    from zoo.scoring.table import drives_table, mean_and_spread

    load_checkpoint(checkpoint)  # what is wrong with it is said before processes start
    check_options(options)
    names = perturbations_named(options.perturb)
    jobs = [(track, seed) for track in options.tracks for seed in range(options.seeds)]
    setups = [Setup.of(options, *job) for job in jobs]
    usual = setups[0]
    swept = sweeps(names, usual)
    # A drive that several sweeps share, as the usual one, is driven once.
    more = [one for by_value in swept.values() for one in by_value.values()]
    more = [one for one in dict.fromkeys(more) if one not in setups]
    folder = _new_folder(options.out)
    places = [folder / f"{Path(track).stem}-{seed}" for track, seed in jobs]
    found = dict(
        zip(
            setups + more,
            drive_all(
                checkpoint, setups + more, places + [None] * len(more), options.workers, console
            ),
            strict=True,
        )
    )
    drives = [found[one] for one in setups]
    tracks = {}
    for track in options.tracks:
        own = [one for one in setups if one.track == track]
        tracks[found[own[0]]["track"]] = mean_and_spread([found[one] for one in own]) | {
            "expert_steering_per_s": (expert_steering_per_s(own[0]), 0.0)
        }
    metrics = {"checkpoint": str(checkpoint), "drives": drives, "tracks": tracks}
    console.print(drives_table(tracks))
    if names:
        results = {
            name: {value: found[one] for value, one in by_value.items()}
            for name, by_value in swept.items()
        }
        metrics["perturbed"] = {
            name: [{"value": value, **one} for value, one in by_value.items()]
            for name, by_value in results.items()
        }
        _show_sweeps(results, usual, folder, console)
    (folder / "metrics.json").write_text(json.dumps(metrics, indent=1, allow_nan=False) + "\n")
    console.print(str(folder), highlight=False, markup=False, soft_wrap=True)
    return metrics


def _show_sweeps(results: dict, usual: "Setup", folder: Path, console: Console) -> None:
    from zoo.plots import save_figure
    from zoo.scoring.figures import degradation_curves
    from zoo.scoring.robustness import PERTURBATIONS, sweep_table

    console.print(sweep_table(results, usual))
    figure = degradation_curves(
        {PERTURBATIONS[name].label: by_value for name, by_value in results.items()},
        {PERTURBATIONS[name].label: PERTURBATIONS[name].usual(usual) for name in results},
        f"{Path(usual.track).stem}, {usual.laps:g} laps at {usual.speed_mph:g} mph; dotted: usual",
    )
    save_figure(figure, folder / "robustness.png")


def _new_folder(out: str | None) -> Path:
    now = datetime.datetime.now()
    folder = Path(out or f"outputs/evaluations/{now:%Y-%m-%d}/{now:%H-%M-%S-%f}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InputError(f"{folder}: is not empty; name another folder with out=")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written to ({error.strerror})") from None
    return folder


def command(arguments: list[str]) -> None:
    """The command: a checkpoint's path, then `key=value` options, see `EvaluateOptions`."""
    from zoo.scoring import options

    if not arguments or {"-h", "--help"} & set(arguments):
        from simulator.__main__ import help_text

        if not arguments:
            raise InputError(f"usage: {USAGE}; --help lists the options")
        print(f"usage: {USAGE}\n\n{help_text(options)}")
        return
    checkpoint, *rest = arguments
    recordings = [one.partition("=")[2] for one in rest if one.startswith("replay=")]
    if recordings:
        from zoo import replay

        others = [one for one in rest if not one.startswith("replay=")]
        replay.command([checkpoint, *recordings, *others])
        return
    evaluate(checkpoint, options.options_from(rest), Console())


if __name__ == "__main__":
    sys.exit(run_command("zoo.evaluate", command, sys.argv[1:]))
