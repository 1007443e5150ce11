"""The sections on settings and the model card."""

from omegaconf import OmegaConf

from zoo.report.blocks import Block, Bullets, Code, Fold, Heading, Rows, Text
from zoo.report.reported_run import ReportedRun
from zoo.report.training_section import worse_than_nothing
from zoo.runs.table import Table
from zoo.verdict.evidence import training_command

GROUPS = ("model", "data", "augment", "loss", "optim", "schedule", "trainer", "callbacks", "score")
INTENDED_USE = (
    "Steer the car of its recording (the simulator's, or a model car) off public roads, study "
    "behavioural cloning, and compare networks. Do not use it for a vehicle on a real road: "
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
    """Return the options of the run's config groups, the versions and the config."""
    chosen = {group: run.choices[group] for group in GROUPS if run.choices.get(group)}
    chosen["data.root"] = run.config["data"].get("root")  # data=lake does not name its folder
    rows = [
        [group, ", ".join(map(str, one)) if isinstance(one, list) else str(one)]
        for group, one in chosen.items()
    ]
    versions = list((run.metrics.get("versions") or {}).items())
    return [
        Rows(Table.of(["group", "option"], rows), left=2),
        Fold("Versions", [Rows(Table.of(["package", "version"], versions), left=2)]),
        Fold("Complete config", [Code(OmegaConf.to_yaml(OmegaConf.create(run.config)))]),
    ]


def use(run: ReportedRun) -> list[Block]:
    """Return the intended use."""
    return [Heading("Intended use"), Text(INTENDED_USE)]


def limits(run: ReportedRun) -> list[Block]:
    """Return what the run does not show, and the licence."""
    points = ["It has not been driven: nothing here shows that it stays on a road."]
    if run.replayed:
        points = [f"Not driven on a road: its score is a {run.replayed}."]
    elif run.tracks:
        points = [
            f"Driven only on the {' and '.join(run.tracks)}, in clear weather unless the settings "
            "name another. Other tracks, speeds, weather and delays are not tested; test them with "
            "drivezoo evaluate CKPT track=lake,mountain perturb=all."
        ]
    points += [str(one["text"]) for one in run.metrics.get("findings") or []]
    if run.config["data"]["split"] == "random":
        points.append("Random split: held-out rows are neighbours of training rows.")
    if worse := worse_than_nothing(run):
        points.append(worse)
    points.append(
        "One training with one training seed: this run does not show how much another training "
        "would differ."
    )
    return [Heading("Limits"), Bullets(points), Heading("Licence"), Text(LICENCE)]
