"""The sections on network, training and open-loop figures, settings, and the model card."""

import re
from dataclasses import dataclass

import torch
from omegaconf import OmegaConf
from rich.console import Console
from torch import nn

from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.models.memory import frame_outputs
from zoo.models.network_facts import facts_of
from zoo.runs.result_table import Table
from zoo.scoring.blocks import Block, Bullets, Code, Fold, Heading, Images, Rows, Text
from zoo.scoring.evidence import training_command
from zoo.scoring.reported_run import ReportedRun

OPEN_LOOP = (
    "Predicted and recorded steering, row by row; this does not show whether the car stays on the "
    "road. Always zero and the mean of the training rows ignore the image. Balanced MAE is the "
    "mean of the MAEs in 21 steering bins. A positive bias is to the right."
)
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


def duration(run: ReportedRun) -> list[Block]:
    """Return the training's epochs, speed and duration."""
    epochs, metrics = run.figures("epochs"), run.metrics
    return [
        Text(
            f"Epochs: {epochs} (best: {metrics.get('best_epoch') or '-'}). Samples per second: "
            f"{metrics.get('samples_per_second') or 0:,.0f}. Total time: {metrics['wall_s']:,.0f} "
            f"s on {metrics['device']}; threads: {metrics['threads']}. Training seed: "
            f"{metrics['seed']}."
        )
    ]


def curves(run: ReportedRun) -> list[Block]:
    """Return the training's curves."""
    caption = (
        "Training loss and validation MSE by epoch. The training loss, with the run's "
        "augmentation and dropout, is usually above the validation MSE."
    )
    return [Images([run.plot("training_curves", caption)])]


def open_loop(run: ReportedRun) -> list[Block]:
    """Return the open-loop figures with those of two baselines."""
    figures, baselines = run.figures("open_loop"), run.figures("baselines")
    table = metrics_table(run.metrics["model"], figures, baselines)
    bold = frozenset(number for number, (part, *_) in enumerate(table.cells) if part)
    worse = worse_than_nothing(run)
    return [Text(OPEN_LOOP), Rows(table, left=2, bold=bold), *([Text(worse)] if worse else [])]


def scatter(run: ReportedRun) -> list[Block]:
    """Return plots of predicted against recorded steering."""
    images = [
        run.plot(f"predicted_against_true_{part}", f"{part} rows, with the line of equality.")
        for part in ("val", "test")
        if part in run.figures("open_loop")
    ]
    if not images:
        raise InputError("The split has neither validation nor test rows.")
    return [Heading("Predicted against recorded steering"), Images(images, columns=2)]


def metrics_table(name: str, figures: dict, baselines: dict) -> Table:
    """Return a table of open-loop figures of the network, of always zero and of the mean.

    Args:
        name: network's name.
        figures: figures by part of the split.
        baselines: figures by part of the split and predictor.
    """
    rows = []
    for part, scores in figures.items():
        for predictor, row in {name: scores, **baselines[part]}.items():
            texts = [f"{row[key]:.4f}" for key in ("mse", "mae", "balanced_mae")]
            shown = part if predictor == name else ""
            rows.append([shown, predictor, *texts, f"{round(row['bias'], 4) + 0.0:+.4f}"])
    return Table.of(["rows", "predictor", "MSE", "MAE", "balanced MAE", "bias"], rows)


def print_metrics(table: Table, console: Console) -> None:
    """Print `metrics_table`; a part of the split begins with the network's row."""
    title = "steering, centre camera, best checkpoint"
    shown = table.printed(left=2, title=title, title_justify="left")
    for number, (part, *_) in enumerate(table.cells):
        shown.rows[number].style = "bold" if part else "dim"
    console.print(shown)


def worse_than_nothing(run: ReportedRun) -> str:
    """Return a sentence on the parts whose MSE is not below that of always zero; empty for none."""
    figures, baselines = run.metrics.get("open_loop") or {}, run.metrics.get("baselines") or {}
    worse = [
        part
        for part in ("val", "test")
        if part in figures and figures[part]["mse"] >= baselines[part]["always zero"]["mse"]
    ]
    if not worse:
        return ""
    return (
        f"On {' and '.join(worse)} rows its MSE is not below that of always zero, a predictor that "
        "ignores the image. This does not show how it drives."
    )


@dataclass(frozen=True)
class Layer:
    """A call of a layer.

    Attributes:
        name: name in the network; empty for parameters outside layers.
        kind: class and settings.
        shape: shape of the output, without the batch.
        parameters: number of parameters that no earlier call has counted.
    """

    name: str
    kind: str
    shape: tuple[int, ...]
    parameters: int


def network_layers(network: nn.Module, shape: tuple[int, int, int]) -> list[Layer]:
    """Return the layers in the order of a forward pass.

    The parameters add up to the network's: a layer that is used twice counts once, and parameters
    outside layers get their own entry.

    Args:
        network: network of the zoo.
        shape: `(height, width, channels)` of the view.
    """
    layers: list[Layer] = []
    counted: set[int] = set()
    names = {module: name for name, module in network.named_modules()}

    def note(module: nn.Module, _: object, output: torch.Tensor) -> None:
        weights = [p for p in module.parameters() if id(p) not in counted]
        counted.update(map(id, weights))
        kind = f"{type(module).__name__} ({_details(module)})".removesuffix(" ()")
        size = sum(p.numel() for p in weights)
        layers.append(Layer(names[module], kind, tuple(output.shape[1:]), size))

    leaves = [module for module in network.modules() if not list(module.children())]
    hooks = [leaf.register_forward_hook(note) for leaf in leaves]
    height, width, channels = shape
    try:
        with torch.inference_mode():
            frame_outputs(network.eval(), torch.zeros(1, channels, height, width), torch.zeros(1))
    finally:
        for hook in hooks:
            hook.remove()
    if rest := [p for p in network.parameters() if id(p) not in counted]:
        layers.append(Layer("", "parameters outside layers", (), sum(p.numel() for p in rest)))
    return layers


def layers_table(run: ReportedRun) -> list[Block]:
    """Return a summary of the network and the table of its layers."""
    from zoo.models.make_network import multiply_adds, paper

    checkpoint: Checkpoint = run.checkpoint
    network, view = checkpoint.network, checkpoint.view
    layers = network_layers(network, view.shape)
    height, width, channels = view.shape
    total = sum(layer.parameters for layer in layers)
    trained = sum(p.numel() for p in network.parameters() if p.requires_grad)
    rows = [
        [layer.name, layer.kind, " x ".join(map(str, layer.shape)), f"{layer.parameters:,}"]
        for layer in layers
    ]
    rows.append(["total", "", "", f"{total:,}"])
    facts = facts_of(network)
    inputs = "image and speed" if facts.takes_speed else "image"
    outputs = "steering and throttle" if facts.outputs == 2 else "steering"
    outputs += " with its spread" if facts.predicts_spread else ""
    window = f" It was trained on {facts.window}." if facts.window else ""
    return [
        Text(
            f"{run.config['model']['name']}: {paper(network)}. Input: {inputs}. Output: {outputs}."
            f"{window} {total:,} parameters ({trained:,} of them trained), "
            f"{multiply_adds(network, (channels, height, width)):,} multiply-adds per frame."
        ),
        Text(
            f"The view crops {view.crop_text}. Its colour is {view.colour}, its size {height} x "
            f"{width} (resize: {view.resize}). The checkpoint stores the view, so driving uses "
            "the same. The network itself scales the pixels."
        ),
        Rows(
            Table.of(["layer", "type", "output", "parameters"], rows),
            left=2,
            bold=frozenset({len(rows) - 1}),
        ),
    ]


def _details(module: nn.Module) -> str:
    """Return PyTorch's text on a layer's settings, without common defaults."""
    text = re.sub(r"\d+\.\d{4,}", lambda match: f"{float(match[0]):.3g}", module.extra_repr())
    return text.replace(", inplace=False", "").replace(", bias=True", "")


def command(run: ReportedRun) -> list[Block]:
    """Return the command of the run."""
    return [
        Text(
            "Run this command in the folder where the run was started. With the same versions, on "
            "a CPU with the same number of threads, it trains the same weights."
        ),
        Code(training_command([str(override) for override in run.overrides], {})),
    ]


def settings(run: ReportedRun) -> list[Block]:
    """Return the options of the run's config groups, the versions and the config."""
    chosen = {group: run.choices[group] for group in GROUPS if run.choices.get(group)}
    chosen["data.root"] = root = run.config["data"].get("root")
    if (run.config["data"].get("record") or {}).get("out") not in (None, root):
        chosen.pop("data", None)  # data=lake, whose laps were not used
    rows = [
        [group, ", ".join(map(str, value)) if isinstance(value, list) else str(value)]
        for group, value in chosen.items()
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
    points += [str(finding["text"]) for finding in run.metrics.get("findings") or []]
    if run.config["data"]["split"] == "random":
        points.append("Random split: held-out rows are neighbours of training rows.")
    if worse := worse_than_nothing(run):
        points.append(worse)
    points.append(
        "One training with one training seed: this run does not show how much another training "
        "would differ."
    )
    return [Heading("Limits"), Bullets(points), Heading("Licence"), Text(LICENCE)]
