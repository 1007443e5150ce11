"""The card of a checkpoint that travels with it: on the Hub, in an ONNX file, in a C header."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from zoo.base.rig import CURVATURE, UDACITY
from zoo.checkpoints.checkpoint import Checkpoint, build_checkpoint, read_checkpoint_file
from zoo.checkpoints.checkpoint_path import packaged_name, read_facts
from zoo.checkpoints.new_checkpoint import lean_contents, without_folders
from zoo.driving.drives_table import drives_table
from zoo.driving.intervals import ONE_TRACK
from zoo.models.make_network import multiply_adds
from zoo.models.network_facts import facts_of
from zoo.scoring.blocks import Block, Bullets, Code, Rows, Section, Text, to_markdown
from zoo.scoring.evidence import Evidence, read_evidence
from zoo.scoring.training_section import INTENDED_USE


@dataclass(frozen=True)
class Described:
    """What a card describes.

    Attributes:
        contents: contents of the checkpoint's file for other people, see `lean_contents`.
        checkpoint: checkpoint of the training.
        evidence: metrics and command of the run.
        facts: drives and command of a network that comes with drivezoo; empty for another one.
    """

    contents: dict
    checkpoint: Checkpoint
    evidence: Evidence
    facts: Mapping

    @property
    def name(self) -> str:
        """Return the name of the network's config."""
        return str(self.checkpoint.config["model"].get("name") or "network")

    @property
    def tracks(self) -> dict[str, dict]:
        """Return the figures of each track that the run drove."""
        tracks = (self.evidence.metrics.get("drive") or {}).get("tracks") or {}
        return {name: row for name, row in tracks.items() if row and row.get("autonomy")}


def describe(path: Path) -> Described:
    """Return what the card of a checkpoint describes.

    Raises:
        InputError: the checkpoint cannot be loaded.
    """
    contents = read_checkpoint_file(path)
    checkpoint = build_checkpoint(contents, path)
    evidence = read_evidence(path, checkpoint.config, checkpoint.data)
    facts = read_facts(packaged) if (packaged := packaged_name(path)) else {}
    return Described(lean_contents(contents), checkpoint, evidence, facts)


def card_text(of: Described, points: list[str]) -> str:
    """Return a whole card as Markdown; see `card_sections`."""
    return to_markdown(of.name, card_sections(of, points))


def card_sections(of: Described, points: list[str]) -> list[Section]:
    """Return the sections that every card has.

    Args:
        of: checkpoint.
        points: further sentences on the network or its file.
    """
    return [
        Section("", [Bullets([*_network(of.checkpoint), *points])]),
        Section("Units and signs", [Bullets(_units(of.checkpoint))]),
        Section("How it drives", _scores(of)),
        Section("Training", _training(of)),
        Section("Intended use", [Text(INTENDED_USE)]),
    ]


def _network(checkpoint: Checkpoint) -> list[str]:
    network, view = checkpoint.network, checkpoint.view
    parameters = sum(parameter.numel() for parameter in network.parameters())
    height, width, channels = view.shape
    operations = multiply_adds(network, (channels, height, width))
    resized = f", resized to {height} x {width} (resize={view.resize})" * bool(view.size)
    return [
        f"Network: {type(network).__name__}, {parameters:,} parameters, {operations:,} "
        "multiply-adds a frame. It steers a car from the images of one camera.",
        f"View: without {view.crop_text}, colour {view.colour}{resized}.",
    ]


def _units(checkpoint: Checkpoint) -> list[str]:
    """Return what the numbers mean, and for which car."""
    facts, data = facts_of(checkpoint.network), checkpoint.data
    scale, rate = data.get(CURVATURE), round(data.get("rows_per_s") or 0, 1) or "unknown"
    curvature = f"; it is the curvature of the path in {scale:.6g} 1/m" if scale else ""
    points = [
        "Input: RGB frames of {1} x {0} pixels, 0..255.".format(*checkpoint.view.frame),
        *["Input: speed in miles per hour."] * facts.takes_speed,
        *[f"Memory: of earlier frames; frames/s of its recording: {rate}."] * bool(facts.window),
        f"Output: steering -1..1, negative is left{curvature}.",
        *["Output: throttle -1..1, negative brakes."] * (facts.outputs > 1),
        *["Output: logarithm of the steering's standard deviation."] * facts.predicts_spread,
    ]
    if source := data.get("source"):
        return [*points, f"Rig: that of its recording ({source}); the checkpoint has no numbers."]
    camera = UDACITY.cameras["center"]
    return [
        *points,
        f"Rig: {UDACITY.name}; steering 1 turns the front wheels by {UDACITY.steering_deg:g} "
        f"degrees, wheelbase {UDACITY.wheelbase_m:.2f} m; the camera is {camera.up_m:g} m up, "
        f"pitched down by {camera.pitch_down_deg:g} degrees, and sees "
        f"{camera.vertical_fov_deg:g} degrees from top to bottom.",
    ]


def _scores(of: Described) -> list[Block]:
    if of.facts:
        lake, unseen = (of.facts["drives"][key] for key in ("lake", "unseen"))
        points = [
            f"Track of its simulator: {lake['kept']} of {lake['drives']} laps without an "
            f"intervention, mean cross-track error {lake['cte_mean_m']:.2f} m. {ONE_TRACK} "
            f"Measured by: {lake['command']}.",
            f"Roads that it was not trained on: {unseen['kept']} of {unseen['drives']} drives "
            f"without an intervention. Measured by: {unseen['command']}.",
        ]
        return [Bullets(points)]
    if not of.tracks:
        return [Text("Its run has no drives: nothing here shows that it stays on a road.")]
    scored = of.evidence.metrics.get("drive") or {}
    where = scored.get("replayed") or "Drives of its run in drivezoo's embedded simulator"
    text = f"{where}, at {speed:g} mph." if (speed := scored.get("speed_mph")) else f"{where}."
    return [Text(text), Rows(drives_table(of.tracks))]


def _training(of: Described) -> list[Block]:
    card = of.contents["drivezoo"]
    data, code = card["data"], of.facts.get("code") or of.evidence.metrics.get("code") or {}
    rows = f"{data['rows']:,} rows" if data.get("rows") else "rows of an unknown number"
    points = [f"Recording: {rows} with fingerprint {data.get('fingerprint') or 'unknown'}."]
    if (seed := card["config"].get("seed")) is not None:
        points.append(f"Training seed: {seed}.")
    if code:
        points.append(f"Code: {code.get('hash')}, commit {code.get('commit') or 'unknown'}.")
    command = of.facts.get("command") or of.evidence.again({})
    return [Bullets(points), *([Code(without_folders(command))] if command else [])]
