"""The sections on settings and the model card."""

import numpy as np
from omegaconf import OmegaConf

from datamodules.findings import KEYBOARD_SHARE
from zoo.report.blocks import Block, Bullets, Code, Fold, Heading, MissingError, Rows, Text
from zoo.report.headline import main_figures
from zoo.report.reported_run import ReportedRun
from zoo.report.training_section import worse_than_nothing
from zoo.runs.table import Table
from zoo.verdict.evidence import training_command

GROUPS = ("model", "data", "augment", "loss", "optim", "schedule", "trainer", "callbacks", "score")
INTENDED_USE = (
    "Steer the car of a driving simulator (the course's simulator of 2016, or the embedded one), "
    "study behavioural cloning, and compare networks. Do not use it for a vehicle on a real road: "
    "it does not recognize traffic, signs or people, and cannot tell when it is wrong."
)
LICENCE = (
    "The code (drivezoo) has the MIT licence. The weights have no licence of their own: the person "
    "who publishes them chooses one that the terms of the recording, and of other weights that the "
    "training started from (model.weights), allow. Recordings of the embedded simulator are free "
    "to use."
)


def command(run: ReportedRun) -> list[Block]:
    """Return the command of the run."""
    return [
        Text(
            "Run this command in the folder where the run was started. With the same versions, on "
            "a CPU with the same number of threads, it trains the same weights."
        ),
        Code(training_command([str(one) for one in run.overrides], {})),
    ]


def settings(run: ReportedRun) -> list[Block]:
    """Return the options of the run's config groups, and the config."""
    chosen = {group: run.choices[group] for group in GROUPS if run.choices.get(group)}
    chosen["data.root"] = run.config["data"].get("root")  # data=lake does not name its folder
    rows = [
        [group, ", ".join(map(str, one)) if isinstance(one, list) else str(one)]
        for group, one in chosen.items()
    ]
    config = OmegaConf.to_yaml(OmegaConf.create(run.config))
    return [
        Rows(Table.of(["group", "option"], rows), left=2),
        Fold("Complete config", [Code(config)]),
    ]


def versions(run: ReportedRun) -> list[Block]:
    """Return the versions of the packages."""
    table = Table.of(["package", "version"], list(run.figures("versions").items()))
    return [Fold("Versions", [Rows(table, left=2)])]


def use(run: ReportedRun) -> list[Block]:
    """Return the intended use, and what the network learnt from."""
    data = run.config["data"]
    return [
        Heading("Intended use"),
        Text(INTENDED_USE),
        Heading("Data and training"),
        Text(
            f"Supervised learning from recorded steering. Cameras: {', '.join(data['cameras'])} "
            f"(offset of side cameras: {data['offset']:g}). Augmentation: "
            f"{', '.join(data.get('augment') or {}) or 'none'}. See Data and Settings."
        ),
    ]


def measured(run: ReportedRun) -> list[Block]:
    """Return the main figures."""
    points = [f"{name}: {value}; {details}" for name, value, details in main_figures(run)]
    if not points:
        raise MissingError("Nothing was measured.")
    return [Heading("Metrics"), Bullets(points)]


def limits(run: ReportedRun) -> list[Block]:
    """Return what the run does not show, and the licence."""
    points = [*_limits_of_driving(run), *_limits_of_data(run)]
    if worse := worse_than_nothing(run):
        points.append(worse)
    if run.config.get("quick"):
        points.append("quick=true: a short training, not the full recipe.")
    points.append(
        "One training with one training seed: this run does not show how much another training "
        "would differ."
    )
    return [Heading("Limits"), Bullets(points), Heading("Licence"), Text(LICENCE)]


def _limits_of_driving(run: ReportedRun) -> list[str]:
    if not run.tracks:
        return ["It has not been driven: nothing here shows that it stays on a road."]
    points = [
        f"Driven only on the {' and '.join(run.tracks)}, in clear weather unless the settings name "
        "another. Other tracks, speeds, weather and delays are not tested; test them with drivezoo "
        "evaluate CKPT track=lake,mountain perturb=all."
    ]
    if any(figures.get("drives") == 1 for figures in run.tracks.values()):
        points.append("One drive on a track: its figures have no spread.")
    return points


def _limits_of_data(run: ReportedRun) -> list[str]:
    data, points = run.config["data"], []
    try:
        zeros = float(np.mean(run.recording.steering == 0))
    except MissingError:
        zeros = 0.0
    if zeros > KEYBOARD_SHARE:
        points.append(
            f"{zeros:.0%} of the recorded steering is exactly 0, as from a keyboard: such labels "
            "are less exact than those of a mouse or a wheel."
        )
    if data["split"] == "random":
        points.append("Random split: held-out rows are neighbours of training rows.")
    if list(data["cameras"]) == ["center"]:
        points.append("Trained on the centre camera only: it has seen hardly any recoveries.")
    return points
