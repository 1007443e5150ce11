"""The last sections: settings and the command to repeat a run, and the model card."""

import numpy as np
from omegaconf import OmegaConf

from datamodules.recording_report import KEYBOARD_SHARE
from zoo.drives.intervals import count_with_interval
from zoo.evaluate.drives_table import with_deviation
from zoo.report.blocks import Block, Bullets, Code, Fold, Heading, MissingError, Rows, Text, gather
from zoo.report.reported_run import Run
from zoo.report.training_section import worse_than_nothing
from zoo.verdict.evidence import training_command

GROUPS = ("model", "data", "augment", "loss", "optim", "schedule", "trainer", "callbacks", "score")


def settings_blocks(run: Run) -> list[Block]:
    """The command, the choices, the versions, and the whole config."""
    return gather((_command, _choices, _versions, _config), run)


def card_blocks(run: Run) -> list[Block]:
    """Intended use, data, metrics, limits and licence, as far as the run can tell."""
    return gather((_use, _learnt_from, _measured, _limits, _licence), run)


def _command(run: Run) -> list[Block]:
    command = training_command([str(one) for one in run.overrides], {})
    return [
        Text(
            "From the folder that it was started in. With the same versions, on a CPU with the "
            "same number of threads, it gives the same weights."
        ),
        Code(command),
    ]


def _choices(run: Run) -> list[Block]:
    chosen = [[group, _text(run.choices[group])] for group in GROUPS if run.choices.get(group)]
    if chosen and (root := run.config["data"].get("root")):  # data=lake does not say where it is
        chosen.append(["data.root", _text(root)])
    return [Rows(["group", "choice"], chosen, left=2)] if chosen else []


def _text(choice: object) -> str:
    return ", ".join(map(str, choice)) if isinstance(choice, list) else str(choice)


def _versions(run: Run) -> list[Block]:
    rows = [[package, version] for package, version in run.figures("versions").items()]
    return [Fold("Versions", [Rows(["package", "version"], rows, left=2)])]


def _config(run: Run) -> list[Block]:
    return [Fold("The whole config", [Code(OmegaConf.to_yaml(OmegaConf.create(run.config)))])]


def _use(run: Run) -> list[Block]:
    return [
        Heading("Intended use"),
        Text(
            "To steer the car of a driving simulator (the course's of 2016, or the embedded one), "
            "to study behavioural cloning, and to compare networks. Not for a vehicle on any road: "
            "it knows no traffic, no signs, no people, and has no notion of what it does not know."
        ),
    ]


def _learnt_from(run: Run) -> list[Block]:
    data = run.config["data"]
    cameras = ", ".join(data["cameras"])
    augment = ", ".join(data.get("augment") or {}) or "none"
    return [
        Heading("Data and training"),
        Text(
            f"Supervised: a person's or an expert's steering, row by row. Cameras: {cameras}, side "
            f"cameras offset by {data['offset']:g}. Augmentation: {augment}. Loss: "
            f"{run.choices.get('loss') or 'as in the config'}; see Data and Settings."
        ),
    ]


def _measured(run: Run) -> list[Block]:
    said = [
        f"{track}: autonomy {_autonomy(figures)}, {figures['cte_mean_m'][0]:.2f} m off the "
        f"centreline on average, {run.farthest_m(track):.2f} m at most"
        for track, figures in run.tracks.items()
    ]
    for part, own in (run.metrics.get("open_loop") or {}).items():
        zero = run.metrics["baselines"][part]["always zero"]
        said.append(f"{part} rows: MSE {own['mse']:.4f} (always zero: {zero['mse']:.4f})")
    if not said:
        raise MissingError("Nothing was measured.")
    return [Heading("Metrics"), Bullets(said)]


def _autonomy(figures: dict) -> str:
    said = with_deviation(figures["autonomy"], "{:.1%}", figures.get("drives"))
    if figures.get("drives_without_intervention") is None:
        return said
    kept = count_with_interval(figures["drives_without_intervention"], figures["drives"])
    return f"{said}, drives without intervention {kept}"


def _limits(run: Run) -> list[Block]:
    said = [*_limits_of_driving(run), *_limits_of_data(run)]
    worse = worse_than_nothing(run)
    if worse:
        said.append(
            f"On {' and '.join(worse)} rows its MSE is no better than that of always zero: there, "
            "one that looks at nothing would do as well. Driving is another matter."
        )
    if run.config.get("quick"):
        said.append("quick=true: a first try of few epochs, not the recipe.")
    said.append(
        "One training with one training seed: how much another would change is not known from this "
        "run."
    )
    return [Heading("Limits"), Bullets(said)]


def _limits_of_driving(run: Run) -> list[str]:
    if not run.tracks:
        return ["It has not been driven: nothing here says that it stays on a road."]
    said = [
        f"On the {track} it needed {figures['interventions'][0]:.3g} interventions a drive."
        for track, figures in run.tracks.items()
        if figures["interventions"][0]
    ]
    names = " and ".join(run.tracks)
    said.append(
        f"Driven on the {names} alone, in clear weather unless the settings say otherwise: other "
        "tracks, speeds, light and delays are untried. python -m zoo.evaluate CKPT "
        "track=lake,mountain perturb=all tries them."
    )
    counts = {name: figures.get("drives") for name, figures in run.tracks.items()}
    if 1 in counts.values():
        said.append("One drive on a track: a figure without a spread.")
    return said


def _limits_of_data(run: Run) -> list[str]:
    said = []
    try:
        zeros = float(np.mean(run.recording.steering == 0))
        if zeros > KEYBOARD_SHARE:
            said.append(
                f"{zeros:.0%} of the recorded steering is exactly 0, as a keyboard leaves it: "
                "labels say less than a mouse's or a wheel's."
            )
    except MissingError:
        pass
    if run.config["data"]["split"] == "random":
        said.append("A random split: held-out rows are neighbours of training rows.")
    cameras = run.config["data"]["cameras"]
    if list(cameras) == ["center"]:
        said.append("Trained on the centre camera alone: it has hardly seen how to come back.")
    return said


def _licence(run: Run) -> list[Block]:
    said = (
        "The code, drivezoo, is under the MIT licence. The weights carry no licence of their own: "
        "whoever passes them on decides, within what the recording they were made of allows. One "
        "of the embedded simulator is free to use."
    )
    if run.config["model"].get("weights"):
        said += " They began as other weights (model.weights), whose terms go with them."
    return [Heading("Licence"), Text(said)]
