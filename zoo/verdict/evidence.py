"""Evidence on a network besides its drives, and the commands that train it again."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from simulator.world_settings import WorldSettings
from zoo.base.errors import InputError, UsageError
from zoo.base.terminal import command_line
from zoo.checkpoints.checkpoint_path import short_name
from zoo.runs.run import HYDRA, Run
from zoo.runs.status import read_metrics

Settings = TypeVar("Settings", bound=WorldSettings)


@dataclass(frozen=True)
class Evidence:
    """Evidence on a network besides its drives.

    Attributes:
        checkpoint: path of the checkpoint, or of its run's folder, as commands take it; None
            without a checkpoint.
        config: config of the experiment from the checkpoint; another program's may hold anything.
        metrics: content of the run's `metrics.json`; empty without one.
        source: other car or format of its recording; None for Udacity's rig.
        overrides: arguments of `drivezoo train` that started the run; None if unknown.
    """

    checkpoint: str | None
    config: Mapping = field(default_factory=dict)
    metrics: Mapping = field(default_factory=dict)
    overrides: tuple[str, ...] | None = None
    source: str | None = None

    def at(self, key: str, otherwise: object = None) -> object:
        """Return a value of the config by its dotted key.

        >>> Evidence("best.ckpt", {"data": {"offset": 0.2}}).at("data.offset")
        0.2
        """
        found: object = self.config
        for part in key.split("."):
            if not isinstance(found, Mapping):
                return otherwise
            found = found.get(part)
        return otherwise if found is None else found

    def again(self, changed: Mapping[str, str | None]) -> str | None:
        """Return the command that trained the network, with keys changed.

        Args:
            changed: new value of each key; None removes the key.

        Returns:
            The command; None if the original command is unknown.
        """
        return None if self.overrides is None else training_command(self.overrides, changed)


def read_evidence(checkpoint: Path | str, config: Mapping, data: object = None) -> Evidence:
    """Read the evidence from the run's folder of a checkpoint; skip what cannot be read.

    Args:
        checkpoint: path of the checkpoint.
        config: config of the experiment from the checkpoint.
        data: facts on the recording from the checkpoint.
    """
    folder = Path(checkpoint).parent.parent
    found = evidence_of_run(folder, config, read_metrics(folder))
    is_best = (folder / "checkpoints" / "best.ckpt") == Path(checkpoint)
    name = short_name(folder if is_best else Path(checkpoint))
    return replace(found, checkpoint=name, source=source_of(data))


def evidence_of_run(folder: Path, config: Mapping, metrics: Mapping) -> Evidence:
    """Return the evidence on the best checkpoint of a run, or on its last one."""
    run, overrides = Run(folder), None
    if (folder / HYDRA / "overrides.yaml").exists():
        with suppress(InputError):
            overrides = tuple(run.overrides)
    name = short_name(folder) if run.checkpoint_path else None
    return Evidence(name, config, metrics, overrides, source_of(metrics.get("data")))


def source_of(data: object) -> str | None:
    """Return the other car or format of a recording, by a checkpoint's facts on it."""
    source = data.get("source") if isinstance(data, Mapping) else None
    return source if isinstance(source, str) else None


def no_verdict(source: str) -> str:
    """Return why drives on the embedded tracks give no verdict, and what does instead."""
    return (
        f"no verdict by driving: its recording ({source}) has another camera and another car than "
        "the embedded tracks; score it on drives that it was not trained on: drivezoo replay CKPT "
        "FOLDER"
    )


def with_track(options: Settings, checkpoint: str, data: object) -> Settings:
    """Return the options with the usual track, if none is typed.

    Args:
        options: options of a command that drives, whose track is '' if none is typed.
        checkpoint: checkpoint as the user named it.
        data: facts on its recording.

    Raises:
        UsageError: none is typed for a network of another car, which no track shows.
    """
    if options.track:
        return options
    if source := source_of(data):
        raise UsageError(
            f"{checkpoint}: {no_verdict(source)}; to drive it elsewhere all the same, name a track="
        )
    return replace(options, track=WorldSettings.track)


def next_drive(checkpoint: object, data: object, on_track: Sequence[object]) -> list[object]:
    """Return the words of the command that drives a checkpoint next, on drives of its own car.

    Args:
        checkpoint: checkpoint as commands take it.
        data: facts on its recording.
        on_track: words for a network of Udacity's car, which a track shows.
    """
    return ["replay", checkpoint, "FOLDER"] if source_of(data) else list(on_track)


def other_car_line(data: object, place: str, source: str | None = None) -> str | None:
    """Return a warning if a network drives a car that is not that of its recording.

    Args:
        data: facts on the network's recording from the checkpoint.
        place: where it drives, in words.
        source: other car or format of that place; None for Udacity's rig.
    """
    if not data or source_of(data) == source:  # without facts, nobody knows
        return None
    own, there = (one or "Udacity's simulator" for one in (source_of(data), source))
    return (
        f"another car's network drives {place}: its recording is of {own}, and the camera and the "
        f"car there are of {there}; the figures say nothing about how it drives its own"
    )


def training_command(overrides: Sequence[str], changed: Mapping[str, str | None]) -> str:
    """Return `drivezoo train ...` for the shell, with keys changed, or removed by None.

    >>> training_command(["experiment=lenet", "quick=true"], {"quick": None, "seed": "2"})
    'drivezoo train experiment=lenet seed=2'
    """
    typed = [as_typed(one) for one in overrides]
    kept = [one for one in typed if one.partition("=")[0].lstrip("+~") not in changed]
    kept += [f"{key}={value}" for key, value in changed.items() if value is not None]
    return command_line(["drivezoo", "train", *kept])


def as_typed(override: str) -> str:
    """Return an override without the quotes that a command adds to paths for Hydra.

    >>> as_typed("data.root='/my laps'"), as_typed("model.name='a'")
    ('data.root=/my laps', "model.name='a'")
    """
    from zoo.cli.compose import quote_paths

    plain = override.replace("'", "")
    return plain if quote_paths([plain]) == [override] else override
