"""The files that a push sends: a checkpoint for driving, and its card.

The card is Markdown with a YAML header, as the Hub reads it. `huggingface_hub.ModelCardData` would
write the same header in as many lines, and a push to a folder works without that package.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml

from zoo.base.errors import InputError
from zoo.base.new_folder import command_folder
from zoo.base.terminal import command_line
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint import Checkpoint, build_checkpoint, read_checkpoint_file
from zoo.checkpoints.new_checkpoint import checkpoint_bytes, lean_contents, without_folders
from zoo.evaluate.drives_table import drives_table
from zoo.report.blocks import Block, Bullets, Code, Rows, Section, Text, to_markdown
from zoo.report.training_section import INTENDED_USE
from zoo.verdict.evidence import Evidence, next_drive, read_evidence

HUB = "hub"  # kind of folder
CARD = "README.md"
TAGS = ["drivezoo", "behavioural-cloning", "self-driving", "simulator"]
# Metrics of the header, of those that a track's figures can have.
SHOWN = {"autonomy": "Autonomy", "interventions": "Interventions per drive"}


@dataclass(frozen=True)
class Described:
    """What a card describes.

    Attributes:
        file, data: name and contents of the shared checkpoint.
        checkpoint: checkpoint of the training.
        card: card within the shared checkpoint, without private paths.
        evidence: metrics and command of the run.
        repo: repository, `user/name`; None for none.
        license: abbreviation of the weights' licence; None for none.
    """

    file: str
    data: bytes
    checkpoint: Checkpoint
    card: Mapping
    evidence: Evidence
    repo: str | None
    license: str | None

    @property
    def sha256(self) -> str:
        """Return the hash of the shared checkpoint."""
        return hashlib.sha256(self.data).hexdigest()

    @property
    def tracks(self) -> dict[str, Mapping]:
        """Return the figures of each track that the run drove."""
        tracks = (self.evidence.metrics.get("drive") or {}).get("tracks") or {}
        return {name: one for name, one in tracks.items() if one and one.get("autonomy")}


def shared_files(path: Path, repo: str | None, license_name: str | None) -> dict[str, bytes]:
    """Return the contents of the files of a checkpoint by name: the checkpoint, and its card.

    Args:
        path: checkpoint of a training.
        repo: repository that the card names; None for none.
        license_name: licence of the weights that the card names; None for none.

    Raises:
        InputError: the checkpoint cannot be loaded.
    """
    contents = read_checkpoint_file(path)
    checkpoint = build_checkpoint(contents, path)
    lean = lean_contents(contents)
    name = re.sub(r"\W", "_", str(checkpoint.config["model"].get("name") or "network"))[:60]
    described = Described(
        file=f"{name}.ckpt",
        data=checkpoint_bytes(lean),
        checkpoint=checkpoint,
        card=lean["drivezoo"],
        evidence=read_evidence(path, checkpoint.config, checkpoint.data),
        repo=repo,
        license=license_name,
    )
    return {described.file: described.data, CARD: card_text(described).encode()}


def write_files(files: Mapping[str, bytes], out: str) -> list[Path]:
    """Write the files to a new folder; return their paths.

    Raises:
        InputError: the folder is not empty, or cannot be written to.
    """
    with command_folder(out, HUB) as folder:
        try:
            return [write_whole(folder / name, data) for name, data in files.items()]
        except OSError as error:
            raise InputError(f"{folder}: {error.strerror}; name another folder") from None


def card_text(of: Described) -> str:
    """Return the text of the card."""
    sections = [
        Section("", _what(of)),
        Section("Drive it", _drive(of)),
        Section("How it drives", _scores(of)),
        Section("Training", _training(of)),
        Section("Intended use", [Text(INTENDED_USE)]),
    ]
    header = yaml.safe_dump(_header(of), sort_keys=False, allow_unicode=True)
    return f"---\n{header}---\n\n{to_markdown(_title(of), sections)}"


def described_hash(text: str) -> str | None:
    """Return the checkpoint's hash that a card names; None without one.

    Any text is allowed: the card may come from another person.
    """
    lines = text.partition("\n---")[0].splitlines()
    found = [line.partition(":")[2].strip() for line in lines if line.strip().startswith("sha256:")]
    return found[0] if len(found) == 1 else None


def _header(of: Described) -> dict:
    header: dict = {"license": of.license} if of.license else {}
    header |= {"library_name": "drivezoo", "tags": TAGS, "pipeline_tag": "robotics"}
    header["metrics"] = [key for key in SHOWN if any(one.get(key) for one in of.tracks.values())]
    results = [
        {
            "task": {"type": "robotics", "name": "steering"},
            "dataset": {"type": f"track-{name}", "name": f"{name}, drivezoo's embedded simulator"},
            "metrics": [
                {"type": key, "name": shown, "value": round(float(figures[key][0]), 4)}
                for key, shown in SHOWN.items()
                if figures.get(key)
            ],
        }
        for name, figures in of.tracks.items()
    ]
    if results:
        header["model-index"] = [{"name": _title(of), "results": results}]
    trained_on = of.card["data"].get("fingerprint")
    return header | {"drivezoo": {"file": of.file, "sha256": of.sha256, "data": trained_on}}


def _title(of: Described) -> str:
    return Path(of.file).stem


def _what(of: Described) -> list[Block]:
    network, view = of.checkpoint.network, of.checkpoint.view
    parameters = sum(one.numel() for one in network.parameters())
    height, width, _ = view.shape
    points = [
        f"Network: {type(network).__name__}, {parameters:,} parameters. It steers a car from the "
        "images of one camera.",
        f"View: without {view.crop_text}, colour {view.colour}, resized to {height} x {width}.",
        f"File: {of.file}, {len(of.data):,} bytes, SHA-256 {of.sha256}. It holds weights and "
        "settings, and no code.",
    ]
    points += [
        f"The network's code is not in the file: {one['name']} (SHA-256 begins with "
        f"{one['sha256']}), which its author has. Add it with parts=FILE."
        for one in of.card.get("parts") or ()
    ]
    return [Bullets(points)]


def _drive(of: Described) -> list[Block]:
    fetch = f"pip install 'drivezoo[hub]'\ndrivezoo hub pull {of.repo}\n" if of.repo else ""
    file = f"outputs/hub/{of.repo}/{of.file}" if of.repo else of.file
    words = next_drive(file, of.checkpoint.data, ["drive", file, "sim=lake", "laps=1"])
    return [Code(f"{fetch}{command_line(['drivezoo', *map(str, words)])}")]


def _scores(of: Described) -> list[Block]:
    if not of.tracks:
        return [Text("Its run has no drives: nothing here shows that it stays on a road.")]
    scored = of.evidence.metrics.get("drive") or {}
    speed = scored.get("speed_mph")
    where = scored.get("replayed") or "Drives of its run in drivezoo's embedded simulator"
    text = f"{where}, at {speed:g} mph." if speed else f"{where}."
    return [Text(text), Rows(drives_table(dict(of.tracks)))]


def _training(of: Described) -> list[Block]:
    data, code = of.card["data"], of.evidence.metrics.get("code") or {}
    rows = f"{data['rows']:,} rows" if data.get("rows") else "rows of an unknown number"
    points = [f"Recording: {rows} with fingerprint {data.get('fingerprint') or 'unknown'}."]
    if (seed := of.card["config"].get("seed")) is not None:
        points.append(f"Training seed: {seed}.")
    if code:
        points.append(f"Code: {code.get('hash')}, commit {code.get('commit') or 'unknown'}.")
    blocks: list[Block] = [Bullets(points)]
    if command := of.evidence.again({}):
        blocks.append(Code(without_folders(command)))
    return blocks
