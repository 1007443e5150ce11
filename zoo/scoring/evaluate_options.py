"""Keys of `drivezoo evaluate` and their checks."""

from dataclasses import dataclass, field, replace
from typing import Annotated

from pydantic import Field

from datamodules.format_options import ReadOptions
from zoo.base.command_keys import Section
from zoo.base.errors import UsageError
from zoo.base.process_pool import PROCESSES, Executor
from zoo.driving.scenario import Scenario
from zoo.runs.table_files import ResultFiles, TableFiles
from zoo.simulator.world_settings import WorldSettings

Count = Annotated[int, Field(ge=1)]
Workers = Annotated[int, Field(ge=0)]
ReplayMph = Annotated[float, Field(gt=0, le=200)]


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(ResultFiles, Scenario):
    """Keys of an evaluation.

    Args:
        track: name or YAML file of a track; several are separated by commas; not given: lake, for a
            network of its car.
        seeds: drives on each track, whose seeds begin with `seed`.
        film: true: write film.mp4 in each drive's folder.
        film_speed: playing speed of the film as a multiple of the driven speed.
        record: true: write frames and controls as a recording in each drive's folder, to train on.
        page: false: write no report; true: write report/index.html, see drivezoo report.
        perturb: perturbations to sweep on the first track: names separated by commas, or all.
        replay: recording to score on instead, without a simulator; world=FOLDER does the same; see
            drivezoo replay.
        challenge: published test to score on instead: ch2, the official test of Udacity's Challenge
            2; see drivezoo evaluate challenge=ch2 --help.
        data: folder of the test.
        out: output folder; null: named by date and time.
        plot: file to draw the drives, or the perturbations, in: .pdf, .svg or .png.
        workers: processes that drive; 0: one per core.
        executor: processes; ray or slurm: each drive is a task of a cluster.
    """

    track: str = ""
    weather: str = "clear"
    seeds: Count = 1
    film: bool = False
    film_speed: Annotated[float, Field(ge=1, le=100)] = 1.0
    record: bool = False
    page: bool = True
    perturb: str | None = None
    replay: str | None = None
    challenge: str | None = None
    data: str | None = None
    out: str | None = None
    workers: Workers = 0
    executor: Executor = PROCESSES

    @property
    def tracks(self) -> list[str]:
        """Return the tracks' names or files, each once."""
        return track_names(self.track)

    @property
    def played_at(self) -> float:
        """Return the films' playing speed as a multiple of the driven speed; 0 for no film."""
        return self.film_speed if self.film else 0.0

    @property
    def scenarios(self) -> list[Scenario]:
        """Return the scenario of each drive, by track, then seed."""
        return [
            self.one_drive(track=track, seed=self.seed + number)
            for track in self.tracks
            for number in range(self.seeds)
        ]


@dataclass(frozen=True, kw_only=True)
class ReplayOptions(TableFiles):
    """Keys of a replay.

    Args:
        margin: distance off the recorded path that counts as an intervention, m; null: 1 m, as
            NVIDIA's, or the height of the camera where that is less, as on a toy car.
        frame_rate: rows per second, for image names without a time; null: read from the names.
        speed: mph in each row, for a recording without speed; null: as recorded.
        data: see `ReadOptions`; not given: as in the training, if the network was trained on this
            recording.
        frames: true: keep the frames that the network saw, for drivezoo film.
        out: output folder; null: named by date and time.
    """

    margin: Annotated[float, Field(gt=0, le=2)] | None = None
    frame_rate: float | None = None
    speed: ReplayMph | None = None
    data: Annotated[ReadOptions, Section()] = field(default_factory=ReadOptions)
    frames: bool = False
    out: str | None = None


def track_names(text: str) -> list[str]:
    """Return the names in `lake,mountain`, each once; the usual track of an empty text."""
    return list(dict.fromkeys(filter(None, (text or WorldSettings.track).split(","))))


def check_world(options: WorldSettings) -> tuple[str, ...]:
    """Open the world of each track, and return the keys of a scenario that it ignores.

    Nothing is rendered.

    Raises:
        InputError: a world cannot be opened, as with a wrong track's file.
        UsageError: there is no such track or world, or it ignores a key of the options.
    """
    from zoo.driving.open_world import open_world

    if not (names := track_names(options.track)):
        raise UsageError("track=: no track named; try track=lake,mountain")
    options.check()
    for name in names:
        if isinstance(options, Scenario):
            scenario = options.one_drive(track=name)
        else:
            scenario = Scenario(**replace(options, track=name).place)
        world = open_world(scenario, renderer="none")
        world.close()
    return world.ignores
