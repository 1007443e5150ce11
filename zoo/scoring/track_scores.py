"""Scores of a checkpoint on several tracks, for `zoo.commands.evaluate` and for runs."""

from collections import Counter, deque
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from omegaconf import DictConfig
from pydantic import Field
from rich.console import Console

from datamodules.recorded_car import write_rig_of
from zoo.base.command_keys import keys_of
from zoo.base.console_progress import working
from zoo.base.errors import InputError, placed_errors
from zoo.base.key_values import check_keys, constructed
from zoo.base.process_pool import KilledProcessError
from zoo.base.terminal import counted, print_line
from zoo.base.whole_file import remove_parts
from zoo.checkpoints.checkpoint_path import checkpoint_of
from zoo.checkpoints.policy_base import Policy
from zoo.driving.baseline import Baseline
from zoo.driving.drive_film import FILM_NAME, FRAMES, DriveFilm, WorstMoments
from zoo.driving.drive_log import LOG_NAME, SUMMARY_NAME, KeptFigures, write_drive
from zoo.driving.drive_record import Drive, DriveRow
from zoo.driving.drives_table import mean_and_spread, nan_line, tied_line, with_deviation
from zoo.driving.embedded_world import EmbeddedWorld
from zoo.driving.metrics import steering_per_s
from zoo.driving.replay_world import ReplayWorld
from zoo.driving.run_drives import Keep, all_drives
from zoo.driving.scenario import LAPPED, Scenario
from zoo.driving.world import World
from zoo.runs.plots import save_figure
from zoo.scoring.drive_plots import birds_eye, error_over_distance, road_line
from zoo.scoring.evaluate_options import EvaluateOptions, ReplayMph, check_world
from zoo.simulator.recorder import Recorder, split_pedals
from zoo.simulator.track_names import file_name
from zoo.simulator.weather import CLEAR

TRACK_PLOT, ERROR_PLOT = "track.png", "error.png"


class KeptDrive(KeptFigures):
    """A drive's figures and, in its folder, the drive, its plots and frames of its worst moments.

    The figures hold `nan_frames` only if the policy steered NaN.

    Args:
        folder: folder to write to.
        film_speed: playing speed of the film as a multiple of the driven speed; 0 for no film.
        record: whether to write a recording of the centre camera and the commands.
        film_last_s: seconds at the end of the drive that the film has; None for the whole drive.
    """

    def __init__(
        self,
        folder: Path,
        film_speed: float = 0.0,
        record: bool = False,
        film_last_s: float | None = None,
    ) -> None:
        self.folder, self.film_speed, self.record = folder, film_speed, record
        self.film_last_s = film_last_s

    def __enter__(self) -> "KeptDrive":
        self.moments, self.held = WorstMoments(), ExitStack()
        self.film = self.recorder = None
        if self.record:
            self.recorder = self.held.enter_context(Recorder(self.folder, relative=True))
        self.put_back = False
        return self

    def __exit__(self, *error: Any) -> None:
        self.held.__exit__(*error)

    def begin(self, world: World) -> None:
        """Open the film, at the world's frame rate."""
        if self.film_speed:
            self.world, road = world, None
            if isinstance(world, EmbeddedWorld):
                road = road_line(world.simulated.track)
            film = DriveFilm(self.folder, world.frame_rate, self.film_speed, world.rig, road)
            self.film = self.held.enter_context(film)
            last_s = self.film_last_s
            most = None if last_s is None else round(last_s * world.frame_rate)
            self.waiting: deque[tuple] = deque(maxlen=most)

    def show(self, frame: np.ndarray, row: DriveRow) -> None:
        """Take the next frame and its row."""
        self.moments(frame, row)
        if self.film is not None:
            position: tuple = ()
            if isinstance(self.world, EmbeddedWorld):
                simulated = self.world.simulated
                position = simulated.lap + 1, (simulated.car.x, simulated.car.y)
            if self.film_last_s is None:
                self.film(frame, row, *position)
            else:
                self.waiting.append((frame.copy(), row, *position))
        if self.recorder is not None:
            if self.put_back:
                self.recorder.begin_pass(row.time_s)
            self.put_back = row.intervention
            if not row.intervention:  # the world ignores its command
                numbers = row.steering, *split_pedals(row.throttle), np.nan_to_num(row.speed_mph)
                self.recorder.add({"center": frame}, *numbers, row.time_s)

    def result(self, drive: Drive, policy: Policy, world: World) -> dict[str, Any]:
        """Write the drive, and return its figures."""
        figures = super().result(drive, policy, world)
        if self.recorder is not None:
            write_rig_of(self.folder, world.rig, file_name(drive.track))
        if self.film is not None:
            for shown in self.waiting:
                self.film(*shown)
        names = drive.frame.astype(object)
        for number, name in self.moments.write(self.folder).items():
            names[number] = name
        drive = replace(drive, frame=names.astype(np.str_))
        write_drive(self.folder, drive)
        measured = figures["autonomy"]
        share = "not measured" if measured is None else f"{measured:.1%}"
        title = (
            f"{drive.track}, start seed {drive.seed}: autonomy {share}, "
            f"{counted(figures['interventions'], 'intervention')}"
        )
        if isinstance(world, EmbeddedWorld) and drive.xy is not None:
            track = birds_eye(world.simulated.track, drive.xy, drive, title)
            save_figure(track, self.folder / TRACK_PLOT)
        if figures["cte_max_m"] is not None:
            save_figure(error_over_distance(drive, title), self.folder / ERROR_PLOT)
        return figures


def remove_drives(folder: Path) -> None:
    """Remove the drives below a folder that a stopped command has left there, and nothing else."""
    for drive in [path for path in folder.glob("*") if path.is_dir() and not path.is_symlink()]:
        images = drive / FRAMES
        names = (LOG_NAME, SUMMARY_NAME, FILM_NAME, TRACK_PLOT, ERROR_PLOT)
        for path in (*(drive / name for name in names), *images.glob(f"{'[0-9]' * 6}.jpg")):
            path.unlink(missing_ok=True)
        remove_parts(drive)
        with suppress(OSError):  # has a file of the user's
            if images.is_dir():
                images.rmdir()
            drive.rmdir()


def expert_steering_per_s(scenario: Scenario) -> float:
    """Return the expert's steering change per second on a lap of the embedded world."""
    is_file = ".yaml" in scenario.track or ".yml" in scenario.track  # may change between two laps
    lap = _expert_lap.__wrapped__ if is_file else _expert_lap
    return lap(replace(scenario, seed=0, laps=1.0, weather=CLEAR, margin=None))


@lru_cache
def _expert_lap(scenario: Scenario) -> float:
    (lap,) = all_drives(Baseline("expert"), [scenario], renderer="none")
    return steering_per_s(lap)


@dataclass(frozen=True)
class TrackScores:
    """Figures of a checkpoint's drives.

    Attributes:
        drives: figures of each drive, in the order of tracks, then seeds.
        tracks: mean and deviation over the drives of each track, see `mean_and_spread`.
        by_scenario: figures of each drive by its scenario, the further scenarios included.
    """

    drives: list[dict]
    tracks: dict[str, dict]
    by_scenario: dict[Scenario, dict]


def score_on_tracks(
    driver: str | Policy,
    scenarios: Sequence[Scenario],
    folder: Path,
    console: Console,
    workers: int,
    film_speed: float = 0.0,
    more: Sequence[Scenario] = (),
    executor: str = "processes",
    world: World | None = None,
    record: bool = False,
) -> TrackScores:
    """Drive a checkpoint or a policy on every track with every seed.

    Args:
        driver: checkpoint file, or a policy, which drives in this process.
        scenarios: drives to score.
        folder: folder to write to, each drive into `folder/<track>-<seed>`; without colons, so
            `alpine:17` is `alpine-17`.
        console: console for progress and warnings.
        workers: number of processes; 0 for one per core. It does not change the figures.
        film_speed: playing speed of the films; 0 for no film.
        more: further scenarios to drive, whose figures alone are kept.
        executor: see `run_drives`.
        world: open world to drive in, see `run_drives`.
        record: whether each drive's folder also gets a recording.

    Raises:
        InputError: the simulator cannot be opened, or a process was killed.
    """
    # A scenario that occurs twice, such as the usual one in several sweeps, is driven once.
    more = [scenario for scenario in dict.fromkeys(more) if scenario not in scenarios]
    names = Counter(f"{file_name(scenario.track)}-{scenario.seed}" for scenario in scenarios)
    if (twice := names.most_common(1)[0])[1] > 1:
        name = twice[0].rpartition("-")[0]
        raise InputError(f"two tracks are called {name}; give the files names of their own")
    keeps: list[Keep] = [KeptDrive(folder / name, film_speed, record) for name in names]
    keeps += [KeptFigures()] * len(more)
    driven = [*scenarios, *more]
    what = driving_line(driven) if world is None else "replaying"
    figures = all_drives(
        driver, driven, keeps, workers, what, console, executor=executor, world=world
    )
    by_scenario = dict(zip(driven, figures, strict=True))
    if warning := nan_line(figures):
        console.print(f"warning: {warning}", style="red", highlight=False, markup=False)
    if line := tied_line(figures):
        print_line(console, line)
    tracks = {}
    for track in dict.fromkeys(scenario.track for scenario in scenarios):
        group = [scenario for scenario in scenarios if scenario.track == track]
        name = by_scenario[group[0]]["track"]
        tracks[name] = mean_and_spread([by_scenario[scenario] for scenario in group])
        if group[0].world == Scenario.world:  # the only world that has an expert
            with working("driving the expert for comparison", console):
                tracks[name]["expert_steering_per_s"] = expert_steering_per_s(group[0]), None
    return TrackScores([by_scenario[scenario] for scenario in scenarios], tracks, by_scenario)


def driving_line(scenarios: Sequence[Scenario]) -> str:
    """Return the text beside the progress of drives of equal laps, or of a world without laps."""
    laps = f" of {counted(scenarios[0].laps, 'lap')}" + " each" * (len(scenarios) > 1)
    return counted(len(scenarios), "drive") + laps * (scenarios[0].world in LAPPED)


NOT_OF_RUNS = ("out", "perturb", "record", "page", "replay", "table", "columns", "plot", "executor")


@dataclass(frozen=True, kw_only=True)
class RunScore(EvaluateOptions):
    """Options of a run's `score`: those of an evaluation, and of the choice of `best.ckpt`.

    Args:
        candidate_laps: laps driven with each candidate for `best.ckpt`, in `quality=fast` unless
            `quality` is `simple`; 0 drives none.
        replay_speed: mph in each row in the replay of another car's recording without speed.
    """

    replay_speed: ReplayMph | None = None
    candidate_laps: Annotated[float, Field(ge=0, le=1000)] = 1.0


def run_options(score: DictConfig | None) -> RunScore | None:
    """Read and check the options of a run's `score`; None for `score=none`.

    Raises:
        InputError: a key is unknown, or a value is out of range.
    """
    if not score:
        return None
    from zoo.base.compose import plain_dict

    settings = plain_dict(score)
    with placed_errors("score"):
        check_keys(settings, [key for key in keys_of(RunScore) if key.name not in NOT_OF_RUNS])
        options = RunScore(**constructed(RunScore, settings))
        check_world(options)
        return options


def score_run(
    options: EvaluateOptions | None,
    folder: Path,
    console: Console,
    replayed: ReplayWorld | None = None,
) -> dict | None:
    """Drive a run's best checkpoint, or its last one, and return the figures for `metrics.json`.

    The drives are written to `folder/drives`.

    Args:
        options: options of the drives; None drives nothing.
        folder: folder of the run.
        console: console for progress, figures and the reason why nothing was driven.
        replayed: replay of held-out drives, to drive instead of the tracks of `options`.

    Returns:
        The figures; None if nothing was driven.

    Raises:
        KilledProcessError: a process that drove was killed.
    """
    if options is None:
        return None
    drives, scenarios = folder / "drives", options.scenarios
    if replayed is not None:
        scenarios = [Scenario("held_out", world="replay", margin=options.margin)]
    remove_drives(drives)  # from before the run was resumed
    try:
        scores = score_on_tracks(
            str(checkpoint_of(folder) or folder / "checkpoints" / "last.ckpt"),
            scenarios,
            drives,
            console,
            options.workers,
            options.played_at,
            world=replayed,
        )
    except KilledProcessError:  # the resumed run drives again
        raise
    except InputError as error:  # a missing library must not fail a training of hours
        print_line(console, f"not driven: {error}")
        return None
    driven = "" if replayed is None else replayed.words
    for track, figures in scores.tracks.items():
        if replayed is None:
            laps, mph = figures["laps"][0], figures["speed_mph"][0]
            driven = f"drove {laps:.2f} laps of the {track} at {mph:.1f} mph"
        print_line(console, f"{driven}: {how_well(figures)}")
    how: dict[str, Any] = {
        "speed_mph": None if options.throttle == "network" else options.speed,
        "throttle": options.throttle,
        "laps": options.laps,
        "seeds": options.seeds,
    }
    if replayed is not None:
        how = {"replayed": replayed.words}
    return how | {"tracks": scores.tracks, "drives": scores.drives}


def how_well(figures: dict) -> str:
    """Return the figures of a track's drives, from `mean_and_spread`, in words."""
    count = figures["drives"]
    if figures["autonomy"] is None:
        returned = figures.get("episode_return")
        words = f", return {with_deviation(returned, '{:.1f}', count)}" if returned else ""
        return f"autonomy not measured{words}"
    autonomy = with_deviation(figures["autonomy"], "{:.1%}", count)
    lost = with_deviation(figures["interventions"], "{:.3g}", count)
    kept = f"{figures['drives_without_intervention']} of {count}"
    return (
        f"autonomy {autonomy}, interventions {lost}, drives without intervention {kept}, "
        f"cross-track error {with_deviation(figures['cte_mean_m'], '{:.2f}', count)} m on average, "
        f"maximum {with_deviation(figures['cte_max_m'], '{:.2f}', count)} m"
    )
