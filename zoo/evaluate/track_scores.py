"""Scores of a checkpoint on several tracks, for `zoo.evaluate` and for runs."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

from omegaconf import DictConfig, OmegaConf
from pydantic import Field
from rich.console import Console

from simulator.track_names import file_name
from zoo.base.errors import InputError
from zoo.base.written_files import remove_written
from zoo.checkpoints.command import PolicyFunction
from zoo.cli.command_config import check_options, compose_keys
from zoo.cli.console_progress import working
from zoo.cli.nearest import hint
from zoo.evaluate.drives_table import mean_and_spread, nan_line, with_deviation
from zoo.evaluate.evaluate_options import EvaluateOptions, check_world
from zoo.evaluate.many_drives import Setup, drive_all, expert_steering_per_s


@dataclass(frozen=True)
class TrackScores:
    """Figures of a checkpoint's drives.

    Attributes:
        drives: figures of each drive, in the order of tracks, then seeds.
        tracks: mean and deviation over the drives of each track, see `mean_and_spread`.
        by_setup: figures of each drive by its setup, the further setups included.
    """

    drives: list[dict]
    tracks: dict[str, dict]
    by_setup: dict[Setup, dict]


def score_on_tracks(
    checkpoint: str | PolicyFunction,
    options: EvaluateOptions,
    folder: Path,
    console: Console,
    more: Sequence[Setup] = (),
) -> TrackScores:
    """Drive a checkpoint or a policy on every track with every seed.

    Args:
        checkpoint: checkpoint file, or a policy, which drives in this process.
        options: options of the drives.
        folder: folder to write to, each drive into `folder/<track>-<seed>`; without colons, so
            `alpine:17` is `alpine-17`.
        console: console for progress and warnings.
        more: further setups to drive, whose figures alone are kept.

    Raises:
        InputError: the simulator cannot be opened, or a process was killed.
    """
    jobs = [(track, seed) for track in options.tracks for seed in range(options.seeds)]
    setups = [Setup.of(options, *job) for job in jobs]
    # A setup that occurs twice, such as the usual one in several sweeps, is driven once.
    more = [one for one in dict.fromkeys(more) if one not in setups]
    places = [folder / f"{file_name(track)}-{seed}" for track, seed in jobs]
    found = drive_all(
        checkpoint, setups + more, places + [None] * len(more), options.workers, console
    )
    by_setup = dict(zip(setups + more, found, strict=True))
    if warning := nan_line(found):
        console.print(f"warning: {warning}", style="red", highlight=False, markup=False)
    tracks = {}
    for track in options.tracks:
        own = [one for one in setups if one.track == track]
        with working("driving the expert for comparison", console):
            expert = expert_steering_per_s(own[0])
        tracks[by_setup[own[0]]["track"]] = mean_and_spread([by_setup[one] for one in own]) | {
            "expert_steering_per_s": (expert, None)
        }
    return TrackScores([by_setup[one] for one in setups], tracks, by_setup)


@dataclass(frozen=True, kw_only=True)
class RunScore(EvaluateOptions):
    """Options of a run's `score`: those of an evaluation, and of the choice of `best.ckpt`.

    Args:
        candidate_laps: laps driven with each candidate for `best.ckpt`; 0 drives none.
    """

    candidate_laps: Annotated[float, Field(ge=0, le=1000)] = 1.0


def run_options(score: DictConfig | None) -> RunScore | None:
    """Read and check the options of a run's `score`; None for `score=none`.

    Raises:
        InputError: a key is unknown, or a value is out of range.
    """
    settings = OmegaConf.to_container(score, resolve=True) if score else {}
    if not settings:
        return None
    known = {field.name for field in fields(RunScore)} - {
        "out",
        "perturb",
        "replay",
        "guard",
        "table",
        "plot",
    }
    unknown = sorted(set(settings) - known)
    if unknown:
        raise InputError(f"score.{unknown[0]}: no such key; {hint(unknown[0], sorted(known))}")
    if not isinstance(settings.get("track", ""), str):
        settings["track"] = ",".join(settings["track"])
    if isinstance(settings.get("weather"), dict):
        settings["weather"] = str(settings["weather"])
    try:
        # The score's YAML lacks some keys: they have the defaults of an evaluation.
        options = check_options(RunScore, compose_keys("evaluate") | settings)
        check_world(options)
    except InputError as error:
        raise InputError(f"score: {error}") from None
    return options


def score_run(options: EvaluateOptions | None, folder: Path, console: Console) -> dict | None:
    """Drive a run's best checkpoint, or its last one, and return the figures for `metrics.json`.

    The drives are written to `folder/drives`.

    Args:
        options: options of the drives; None drives nothing.
        folder: folder of the run.
        console: console for progress, figures and the reason why nothing was driven.

    Returns:
        The figures; None if nothing was driven.
    """
    if options is None:
        return None
    best, last = (folder / "checkpoints" / f"{name}.ckpt" for name in ("best", "last"))
    drives = folder / "drives"
    remove_written(drives)  # from before the run was resumed
    try:
        found = score_on_tracks(str(best if best.is_file() else last), options, drives, console)
    except InputError as error:  # a missing library must not fail a training of hours
        console.print(f"not driven: {error}", highlight=False, markup=False)
        return None
    for track, figures in found.tracks.items():
        console.print(
            f"drove {figures['laps'][0]:.2f} laps of the {track} {_at(options, figures)}: "
            f"{how_well(figures)}",
            highlight=False,
            markup=False,
        )
    return {
        "speed_mph": None if options.throttle == "network" else options.speed,
        "throttle": options.throttle,
        "laps": options.laps,
        "seeds": options.seeds,
        "tracks": found.tracks,
        "drives": found.drives,
    }


def how_well(figures: dict) -> str:
    """Return the figures of a track's drives, from `mean_and_spread`, in words."""
    count = figures["drives"]
    autonomy = with_deviation(figures["autonomy"], "{:.1%}", count)
    lost = with_deviation(figures["interventions"], "{:.3g}", count)
    kept = f"{figures['drives_without_intervention']} of {count}"
    return (
        f"autonomy {autonomy}, {lost} interventions, drives without intervention {kept}, "
        f"cross-track error {with_deviation(figures['cte_mean_m'], '{:.2f}', count)} m on average, "
        f"{figures['cte_max_m'][0]:.2f} m at most"
    )


def _at(options: EvaluateOptions, figures: dict) -> str:
    if options.throttle == "network":
        return f"with its own throttle, at {figures['speed_mph'][0]:.1f} mph"
    return f"at {options.speed:g} mph"
