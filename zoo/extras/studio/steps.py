"""The steps of the page: fields that are checked here, and the commands that they are."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from zoo.base.command import is_path
from zoo.base.conf_files import choices
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint_path import OUTPUTS, packaged_names, runs_below, short_name
from zoo.extras.studio.child_command import begun_runs
from zoo.simulator.track_names import track_names
from zoo.training.sweep_record import NAME as SWEEP

RECORDINGS = (OUTPUTS / "recordings", Path("recordings"))
UPLOADS = OUTPUTS / "studio" / "uploads"
DAYS = {
    "clear": "clear",
    "fog": "{fog: 0.4}",
    "rain": "{rain: 0.6, wet: 1}",
    "dusk": "{brightness: 0.6}",
    "drawn": "random",
}
MOST_LISTED = 50
Count = Annotated[int, Field(ge=1, le=5)]


def newest(paths: Sequence[Path]) -> list[str]:
    """Return the paths as a user types them, the newest first."""
    dated = sorted(paths, key=lambda path: path.stat().st_mtime, reverse=True)
    return [short_name(path) for path in dated[:MOST_LISTED]]


def recordings() -> list[str]:
    """Return the folders of recordings, the newest first."""
    below = [path for root in RECORDINGS if root.is_dir() for path in root.iterdir()]
    return newest([path for path in below if path.is_dir() and path.name[0] != "."])


def networks() -> dict[str, list[str]]:
    """Return the networks to watch: runs, those that come with drivezoo, uploaded files."""
    uploads = [*UPLOADS.glob("*.ckpt"), *UPLOADS.glob("*.onnx")]
    runs = [short_name(run) for run in runs_below(OUTPUTS)[: -MOST_LISTED - 1 : -1]]
    return {"runs": runs, "with drivezoo": list(packaged_names()), "uploaded": newest(uploads)}


def chosen(name: str, value: str, among: Sequence[str]) -> str:
    """Return a value that must be among some.

    Raises:
        InputError: it is not.
    """
    if value not in among:
        raise InputError(f"{name}={value}: is no choice of this page; load it again")
    return value


def existing(folder: str) -> str:
    """Return the folder of a recording.

    Raises:
        InputError: there is no such folder.
    """
    path = Path(os.path.expanduser(folder))  # noqa: PTH111 Path's raises for an unknown user
    if not is_path(folder) or not path.is_dir():
        raise InputError(f"{folder}: no such folder")
    # Else it would be a key.
    return str(path.absolute()) if "=" in folder else folder


@dataclass(frozen=True, kw_only=True)
class DriveStep:
    """A drive by hand; `out` is set when it starts."""

    step: Literal["drive"]
    track: str
    day: str = "clear"
    direction: Literal["forward", "backward"] = "forward"

    def keys(self) -> dict[str, str]:
        """Return the keys of the world."""
        track = chosen("track", self.track, track_names())
        weather = DAYS[chosen("day", self.day, list(DAYS))]
        return {"track": track, "weather": weather, "direction": self.direction, "quality": "fast"}

    def commands(self) -> list[list[str]]:
        """Return the words of each command after `drivezoo`."""
        keys = {key: value for key, value in self.keys().items() if value not in USUAL}
        return [["simulator", "drive", *(f"{key}={value}" for key, value in keys.items())]]


USUAL = ("clear", "forward")  # values that a command has anyway


@dataclass(frozen=True, kw_only=True)
class FolderStep:
    """A look at a recording, or its editor; or the ranking of all runs, without a folder."""

    step: Literal["check", "edit", "rank"]
    folder: str = ""

    def commands(self) -> list[list[str]]:
        """Return the words of each command after `drivezoo`."""
        if self.step == "rank":
            return [["leaderboard"]]
        free_port = ["port=0"] if self.step == "edit" else []
        return [[self.step, existing(self.folder), *free_port]]


@dataclass(frozen=True, kw_only=True)
class TrainStep:
    """A training, or the images that it feeds; a run to resume takes the place of the rest.

    With a run of a sweep, all its trainings that are not finished are resumed.
    """

    step: Literal["train", "preview"]
    folder: str = ""
    recipe: str = "first_try"
    augment: list[str] | None = None
    seeds: Count = 1
    quick: bool = False
    resume: str = ""

    def commands(self) -> list[list[str]]:
        """Return the words of each command after `drivezoo`."""
        if self.resume:
            run = Path(chosen("resume", self.resume, [*map(short_name, begun_runs(OUTPUTS))]))
            is_job = (run.parent / SWEEP).is_file()  # its sweep has others to train
            return [["sweep", f"resume={run.parent}"] if is_job else ["train", f"resume={run}"]]
        words = [self.step, f"experiment={chosen('recipe', self.recipe, choices('experiment'))}"]
        words += [f"data.root={existing(self.folder)}"] if self.folder else []
        if self.augment is not None:
            names = [chosen("augment", name, choices("augment")) for name in self.augment]
            words.append(f"augment=[{','.join(names)}]")
        if self.step == "train":
            words += ["quick=true"] * self.quick
            words += [f"seeds={self.seeds}"] * (self.seeds > 1)
        return [words]


@dataclass(frozen=True, kw_only=True)
class WatchStep:
    """Drives of one or two networks, on a track or next to a recorded drive."""

    step: Literal["watch"]
    first: str
    second: str = ""
    track: str = "zoo_lake"
    day: str = "clear"
    folder: str = ""

    @property
    def drivers(self) -> list[str]:
        """Return the networks, as a user types them."""
        known = [name for names in networks().values() for name in names]
        names = [self.first, *filter(None, [self.second])]
        return [chosen("network", name, known) for name in names]

    def keys(self) -> dict[str, str]:
        """Return the keys of the world."""
        if self.folder:
            return {"world": "replay", "track": existing(self.folder)}
        return {
            "track": chosen("track", self.track, track_names()),
            "weather": DAYS[chosen("day", self.day, list(DAYS))],
        }

    def commands(self) -> list[list[str]]:
        """Return the words of each command after `drivezoo`."""
        keys = self.keys()
        words = [f"replay={keys['track']}"] if self.folder else []
        words = words or [f"{key}={value}" for key, value in keys.items() if value not in USUAL]
        return [["evaluate", driver, *words] for driver in self.drivers]


Step = Annotated[DriveStep | FolderStep | TrainStep | WatchStep, Field(discriminator="step")]
