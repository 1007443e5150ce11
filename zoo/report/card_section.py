"""The sections on settings and the model card."""

import numpy as np
from omegaconf import OmegaConf

from datamodules.findings import KEYBOARD_SHARE
from zoo.evaluate.drives_table import with_deviation
from zoo.report.blocks import Block, Bullets, Code, Fold, Heading, MissingError, Rows, Text, gather
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


def settings_blocks(run: ReportedRun) -> list[Block]:
    """Return the run's command, options, versions and config."""
    return gather((_command, _choices, _versions, _config), run)


def card_blocks(run: ReportedRun) -> list[Block]:
    """Return intended use, data, metrics, limits and licence, as far as the run shows them."""
    return gather((_use, _learnt_from, _measured, _limits, _licence), run)


def _command(run: ReportedRun) -> list[Block]:
    command = training_command([str(one) for one in run.overrides], {})
    return [
        Text(
            "Run this command in the folder where the run was started. With the same versions, on "
            "a CPU with the same number of threads, it trains the same weights."
        ),
        Code(command),
    ]


def _choices(run: ReportedRun) -> list[Block]:
    chosen = [[group, _text(run.choices[group])] for group in GROUPS if run.choices.get(group)]
    if chosen and (root := run.config["data"].get("root")):  # data=lake does not name its folder
        chosen.append(["data.root", _text(root)])
    return [Rows(Table.of(["group", "option"], chosen), left=2)] if chosen else []


def _text(choice: object) -> str:
    return ", ".join(map(str, choice)) if isinstance(choice, list) else str(choice)


def _versions(run: ReportedRun) -> list[Block]:
    rows = [[package, version] for package, version in run.figures("versions").items()]
    return [Fold("Versions", [Rows(Table.of(["package", "version"], rows), left=2)])]


def _config(run: ReportedRun) -> list[Block]:
    return [Fold("Complete config", [Code(OmegaConf.to_yaml(OmegaConf.create(run.config)))])]


def _use(run: ReportedRun) -> list[Block]:
    return [
        Heading("Intended use"),
        Text(INTENDED_USE),
    ]


def _learnt_from(run: ReportedRun) -> list[Block]:
    data = run.config["data"]
    cameras = ", ".join(data["cameras"])
    augment = ", ".join(data.get("augment") or {}) or "none"
    return [
        Heading("Data and training"),
        Text(
            f"Supervised learning from recorded steering. Cameras: {cameras} (offset of side "
            f"cameras: {data['offset']:g}). Augmentation: {augment}. Loss: "
            f"{run.choices.get('loss') or 'as in the config'}. See Data and Settings."
        ),
    ]


def _measured(run: ReportedRun) -> list[Block]:
    points = [
        f"{track}: autonomy {_autonomy(figures)}, cross-track error "
        f"{figures['cte_mean_m'][0]:.2f} m on average, {run.farthest_m(track):.2f} m at most"
        for track, figures in run.tracks.items()
    ]
    for part, own in (run.metrics.get("open_loop") or {}).items():
        zero = run.metrics["baselines"][part]["always zero"]
        points.append(f"{part} rows: MSE {own['mse']:.4f} (always zero: {zero['mse']:.4f})")
    if not points:
        raise MissingError("Nothing was measured.")
    return [Heading("Metrics"), Bullets(points)]


def _autonomy(figures: dict) -> str:
    text = with_deviation(figures["autonomy"], "{:.1%}", figures.get("drives"))
    if figures.get("drives_without_intervention") is None:
        return text
    kept = f"{figures['drives_without_intervention']} of {figures['drives']}"
    return f"{text}, drives without intervention {kept}"


def _limits(run: ReportedRun) -> list[Block]:
    points = [*_limits_of_driving(run), *_limits_of_data(run)]
    worse = worse_than_nothing(run)
    if worse:
        points.append(
            f"On {' and '.join(worse)} rows its MSE is not below that of always zero, a predictor "
            "that ignores the image. This does not show how it drives."
        )
    if run.config.get("quick"):
        points.append("quick=true: a short training, not the full recipe.")
    points.append(
        "One training with one training seed: this run does not show how much another training "
        "would differ."
    )
    return [Heading("Limits"), Bullets(points)]


def _limits_of_driving(run: ReportedRun) -> list[str]:
    if not run.tracks:
        return ["It has not been driven: nothing here shows that it stays on a road."]
    points = [
        f"Interventions per drive on the {track}: {figures['interventions'][0]:.3g}."
        for track, figures in run.tracks.items()
        if figures["interventions"][0]
    ]
    names = " and ".join(run.tracks)
    points.append(
        f"Driven only on the {names}, in clear weather unless the settings name another. Other "
        "tracks, speeds, weather and delays are not tested; test them with drivezoo evaluate "
        "CKPT track=lake,mountain perturb=all."
    )
    counts = {name: figures.get("drives") for name, figures in run.tracks.items()}
    if 1 in counts.values():
        points.append("One drive on a track: its figures have no spread.")
    return points


def _limits_of_data(run: ReportedRun) -> list[str]:
    points = []
    try:
        zeros = float(np.mean(run.recording.steering == 0))
        if zeros > KEYBOARD_SHARE:
            points.append(
                f"{zeros:.0%} of the recorded steering is exactly 0, as from a keyboard: such "
                "labels are less exact than those of a mouse or a wheel."
            )
    except MissingError:
        pass
    if run.config["data"]["split"] == "random":
        points.append("Random split: held-out rows are neighbours of training rows.")
    cameras = run.config["data"]["cameras"]
    if list(cameras) == ["center"]:
        points.append("Trained on the centre camera only: it has seen hardly any recoveries.")
    return points


def _licence(run: ReportedRun) -> list[Block]:
    licence = (
        "The code (drivezoo) has the MIT licence. The weights have no licence of their own: the "
        "person who publishes them chooses one that the recording's terms allow. Recordings of the "
        "embedded simulator are free to use."
    )
    if run.config["model"].get("weights"):
        licence += (
            " The training started from other weights (model.weights); their terms apply, too."
        )
    return [Heading("Licence"), Text(licence)]
