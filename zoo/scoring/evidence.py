"""Evidence on a network besides its drives, likely causes, and commands that train it again."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from datamodules.recorded_car import AND, UDACITYS
from zoo.base.errors import InputError, UsageError
from zoo.base.terminal import command_line
from zoo.checkpoints.checkpoint_path import STARTED_IN, short_name, trained_data
from zoo.runs.run_record import HYDRA, Run
from zoo.runs.status import read_metrics
from zoo.simulator.world_settings import WorldSettings

Settings = TypeVar("Settings", bound=WorldSettings)
# Below these values a network rarely drives: docs/offline_metrics.md, docs/recipes.md.
STEERS_BACK = 0.08  # recovery response
ENOUGH_SAMPLES = 50_000
SMALL = 1_000  # a network with fewer parameters needs fewer samples
ROBUST = ("brightness", "shadow", "shift")
UNSEEN = "both_tracks"  # the recipe for roads that were not recorded
OF_RECORDING = ("data", "data.root", "data.format", "data.columns", "data.steering", "data.rig")
MOST_CAUSES = 3


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
        has_rig: whether the camera and the car of its recording are known.
        facts: facts on its recording, see `trained_data`; None if unknown.
        can_train: whether its file can be trained further, unlike one that only drives.
    """

    checkpoint: str | None
    config: Mapping = field(default_factory=dict)
    metrics: Mapping = field(default_factory=dict)
    overrides: tuple[str, ...] | None = None
    source: str | None = None
    has_rig: bool = True
    facts: object = None
    can_train: bool = True

    @property
    def root(self) -> object:
        """Return its recording as a command in this folder takes it."""
        return trained_data(self.config, self.facts).get("root")

    def at(self, key: str, otherwise: Any = None) -> Any:
        """Return a value of the config by its dotted key.

        >>> Evidence("best.ckpt", {"data": {"offset": 0.2}}).at("data.offset")
        0.2
        """
        value: Any = self.config
        for part in key.split("."):
            if not isinstance(value, Mapping):
                return otherwise
            value = value.get(part)
        return otherwise if value is None else value

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
    evidence = evidence_of_run(folder, config, read_metrics(folder))
    is_best = (folder / "checkpoints" / "best.ckpt") == Path(checkpoint)
    name = short_name(folder if is_best else Path(checkpoint))
    source, facts = source_of(data), data or evidence.facts
    return replace(evidence, checkpoint=name, source=source, has_rig=has_rig(data), facts=facts)


def evidence_of_run(folder: Path, config: Mapping, metrics: Mapping) -> Evidence:
    """Return the evidence on the best checkpoint of a run, or on its last one."""
    run, overrides, facts = Run(folder), None, None
    with suppress(InputError):
        facts = {STARTED_IN: run.started_in}
    if (folder / HYDRA / "overrides.yaml").exists():
        with suppress(InputError):
            overrides = tuple(run.overrides)
    name = short_name(folder) if run.checkpoint_path else None
    data = metrics.get("data")
    return Evidence(name, config, metrics, overrides, source_of(data), has_rig(data), facts)


def source_of(data: object) -> str | None:
    """Return the other car or format of a recording, by a checkpoint's facts on it."""
    source = data.get("source") if isinstance(data, Mapping) else None
    return source if isinstance(source, str) else None


def has_rig(data: object) -> bool:
    """Return whether a recording's camera and car are known, by a checkpoint's facts on it."""
    return not isinstance(data, Mapping) or data.get("rig", "") is not None


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


def other_car_line(data: object, where: str, source: str | None = None) -> str | None:
    """Return a warning if a network drives a car that is not that of its recording.

    Args:
        data: facts on the network's recording from the checkpoint.
        where: where it drives, in words.
        source: other car or format of that place; None for Udacity's rig.
    """
    home, there = (car or UDACITYS for car in (source_of(data), source))
    if not data or there in (home, *home.split(AND)):  # without facts, nobody knows
        return None
    return (
        f"another car's network drives {where}: its recording is of {home}, and the camera and the "
        f"car there are of {there}; the figures say nothing about how it drives its own"
    )


def training_command(overrides: Sequence[str], changed: Mapping[str, str | None]) -> str:
    """Return `drivezoo train ...` for the shell, with keys changed, or removed by None.

    >>> training_command(["experiment=lenet", "quick=true"], {"quick": None, "seed": "2"})
    'drivezoo train experiment=lenet seed=2'
    """
    typed = [as_typed(override) for override in overrides]
    kept = [word for word in typed if word.partition("=")[0].lstrip("+~") not in changed]
    kept += [f"{key}={value}" for key, value in changed.items() if value is not None]
    return command_line(["drivezoo", "train", *kept])


def as_typed(override: str) -> str:
    """Return an override as a user types it, without what a command adds for Hydra.

    >>> as_typed("data.root='/my laps'"), as_typed("++trainer.max_steps=9")
    ('data.root=/my laps', 'trainer.max_steps=9')
    """
    from zoo.base.compose import hydra_overrides

    plain = override.replace("'", "").lstrip("+")
    return plain if hydra_overrides([plain]) == [override] else override


@dataclass(frozen=True)
class Cause:
    """A likely reason why a network does not drive.

    Attributes:
        text: sentences that name the cause and what changes.
        changes: new values of keys of the training; None removes a key.
        augment: augmentations to train with, besides those that the training had.
        recipe: experiment to train instead; None for the same one.
    """

    text: str
    changes: Mapping[str, str | None] = field(default_factory=dict)
    augment: tuple[str, ...] = ()
    recipe: str | None = None


def known_tracks(evidence: Evidence) -> dict[str, str]:
    """Return by track what it was used for: `chosen`, `trained`, or `trained and chosen`.

    A drive of the track that chose the checkpoint, or that the training recorded, says little.
    """
    from zoo.simulator.track_names import recorded_name, short_name

    used: dict[str, list[str]] = {}

    def note(tracks: Iterable[str], use: str) -> None:
        for track in tracks:
            used.setdefault(recorded_name(short_name(str(track))), []).append(use)

    # Config and metrics may lack these keys, or are another program's and hold anything.
    with suppress(TypeError, ValueError, LookupError, AttributeError):
        record = evidence.at("data.record")
        if evidence.at("data.root") in (None, record["out"]):  # not another recording
            note([drive["track"] for drive in record["passes"]], "trained")
    with suppress(TypeError, ValueError, LookupError, AttributeError):
        if evidence.metrics["choice"]["drives"]:
            tracks = evidence.at("score.track")
            note((tracks.split(",") if isinstance(tracks, str) else tracks)[:1], "chosen")
    with suppress(TypeError, ValueError, LookupError, AttributeError):
        if evidence.at("callbacks.best.monitor").startswith("drive/"):
            note([evidence.at("callbacks.closed_loop.track")], "chosen")
    return {track: " and ".join(dict.fromkeys(uses)) for track, uses in used.items()}


def likely_causes(evidence: Evidence, tracks: Sequence[str]) -> list[Cause]:
    """Return at most three causes, the likeliest first.

    Args:
        evidence: config and metrics of the network.
        tracks: names of the tracks that the network does not drive.
    """
    causes: list[Cause] = []
    for rule in RULES:
        # Config and metrics lack what a rule reads, or are another program's and hold anything.
        with suppress(TypeError, ValueError, LookupError, AttributeError, ArithmeticError):
            causes += filter(None, [rule(evidence, tracks)])
    return causes[:MOST_CAUSES]


def train_again(evidence: Evidence, causes: Sequence[Cause]) -> str | None:
    """Return the command that trained the network, with the changes of all causes.

    Where a cause names another recipe, it is that of the recipe, with the same recording.

    Returns:
        The command; None if no cause has a change, or the original command is unknown.
    """
    recipe = next((cause.recipe for cause in causes if cause.recipe), None)
    if recipe and evidence.overrides is not None:
        typed = map(as_typed, evidence.overrides)
        kept = [word for word in typed if word.partition("=")[0] in OF_RECORDING]
        return training_command([f"experiment={recipe}", *kept], {})
    changes = {key: value for cause in reversed(causes) for key, value in cause.changes.items()}
    had = _augmentations(evidence)
    names = dict.fromkeys([*had, *(name for cause in causes for name in cause.augment)])
    if len(names) > len(had):
        changes["augment"] = f"[{','.join(names)}]"
    return evidence.again(changes) if changes else None


def _augmentations(evidence: Evidence) -> list[str]:
    """Return the names of the augmentations that the training had."""
    used = evidence.at("data.augment", {})
    return [str(name) for name in used] if isinstance(used, Mapping) else []


def _steers_back(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    responses = evidence.metrics["side_response"].values()
    response = [float(value) for value in responses if value is not None][-1]
    if response >= STEERS_BACK:
        return None
    if evidence.source is not None:  # the limit is in steering of Udacity's car
        return None
    text = (
        "It hardly steers back to the lane's centre: its recovery response to the side cameras is "
        f"{response:+.3f}; networks that drive have 0.2 or more."
    )
    if evidence.at("data.cameras") == ["center"]:
        every = "[center,left,right]"
        return Cause(f"{text} It was trained on the centre camera alone.", {"data.cameras": every})
    larger = max(0.3, round(float(evidence.at("data.offset", 0.0)) + 0.1, 3))
    return Cause(f"{text} A larger data.offset teaches it.", {"data.offset": f"{larger:g}"})


def _quick(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    if not evidence.at("quick"):
        return None
    return Cause("It was trained with quick=true, a short training.", {"quick": None})


def _few_samples(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    samples, epochs = evidence.metrics["train_samples"], evidence.metrics["epochs"]
    if evidence.metrics["parameters"] < SMALL or samples >= ENOUGH_SAMPLES or evidence.at("quick"):
        return None
    changes = {"quick": None, "trainer.max_epochs": str(-(-ENOUGH_SAMPLES * epochs // samples))}
    if not any(override.startswith("callbacks=") for override in evidence.overrides or ()):
        changes["callbacks"] = "published"  # without early stopping
    return Cause(
        f"It was trained on {samples:,} samples; a network of its size needs more epochs.", changes
    )


def _recording(evidence: Evidence, _: Sequence[str]) -> Cause | None:
    # A finding's advice stands behind its semicolon; the training may have followed it.
    texts = [finding["text"].partition("; ")[0] for finding in evidence.metrics["findings"][:2]]
    if not texts:
        return None
    faults = " ".join(f"{text.rstrip('.')}." for text in texts)
    if set(ROBUST) <= set(_augmentations(evidence)):
        return Cause(f"The recording: {faults} drivezoo check names what to record.")
    remedy = f'"augment=[{",".join(ROBUST)}]" makes up for some of it.'
    return Cause(f"The recording: {faults} {remedy}", augment=ROBUST)


def _unseen(evidence: Evidence, tracks: Sequence[str]) -> Cause | None:
    from zoo.simulator.track_names import full_name, recorded_name

    passes = evidence.config["data"]["record"]["passes"]
    recorded = {recorded_name(str(pass_.get("track"))) for pass_ in passes}
    unseen = [full_name(track) for track in tracks if recorded and track not in recorded]
    if not unseen:
        return None
    text = f"Its training images do not show {' and '.join(unseen)};"
    if "pose" in _augmentations(evidence):
        return Cause(f"{text} record more roads.")
    return Cause(f"{text} experiment={UNSEEN} trains for unseen roads.", recipe=UNSEEN)


# The likeliest first.
RULES: tuple[Callable[[Evidence, Sequence[str]], Cause | None], ...] = (
    _quick,
    _steers_back,
    _few_samples,
    _unseen,
    _recording,
)
