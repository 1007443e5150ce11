"""The files that a push sends: a checkpoint for driving, and its card.

The card is Markdown with a YAML header, as the Hub reads it. `huggingface_hub.ModelCardData` would
write the same header in as many lines, and a push to a folder works without that package.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from zoo.base.errors import file_errors
from zoo.base.file_text import yaml_text
from zoo.base.new_folder import command_folder
from zoo.base.terminal import command_line
from zoo.base.whole_file import write_whole
from zoo.checkpoints.new_checkpoint import checkpoint_bytes, without_folders
from zoo.scoring.blocks import Block, Code, Section, to_markdown
from zoo.scoring.evidence import next_drive
from zoo.scoring.model_card import Described, card_sections, describe
from zoo.scoring.parity import own_latency

HUB = "hub"  # kind of folder
CARD = "README.md"
TAGS = ["drivezoo", "behavioural-cloning", "self-driving", "simulator"]
# Metrics of the header, of those that a track's figures can have.
SHOWN = {"autonomy": "Autonomy", "interventions": "Interventions per drive"}


@dataclass(frozen=True)
class SharedFile:
    """A checkpoint's file on the Hub.

    Attributes:
        of: what its card describes.
        file, data: name and contents.
        repo: repository, `user/name`; None for none.
        license: abbreviation of the weights' licence; None for none.
    """

    of: Described
    file: str
    data: bytes
    repo: str | None
    license: str | None

    @property
    def sha256(self) -> str:
        """Return the hash of the contents."""
        return hashlib.sha256(self.data).hexdigest()


def shared_files(path: Path, repo: str | None, license_name: str | None) -> dict[str, bytes]:
    """Return the contents of the files of a checkpoint by name: the checkpoint, and its card.

    Args:
        path: checkpoint of a training.
        repo: repository that the card names; None for none.
        license_name: licence of the weights that the card names; None for none.

    Raises:
        InputError: the checkpoint cannot be loaded.
    """
    of = describe(path)
    name = re.sub(r"\W", "_", of.name)[:60]
    file = f"{name}.ckpt"
    shared = SharedFile(of, file, checkpoint_bytes(of.contents), repo, license_name)
    return {file: shared.data, CARD: card_text(shared).encode()}


def write_files(files: Mapping[str, bytes], out: str) -> list[Path]:
    """Write the files to a new folder; return their paths.

    Raises:
        InputError: the folder is not empty, or cannot be written to.
    """
    errors = file_errors(out, "{}; name another folder with repo=")
    with command_folder(out, HUB, key="repo=") as folder, errors:
        return [write_whole(folder / name, data) for name, data in files.items()]


def card_text(shared: SharedFile) -> str:
    """Return the text of the card."""
    first, *others = card_sections(shared.of, _file(shared))
    sections = [first, Section("Drive it", _drive(shared)), *others]
    return f"---\n{yaml_text(_header(shared))}---\n\n{to_markdown(_title(shared), sections)}"


def described_hash(text: str) -> str | None:
    """Return the checkpoint's hash that a card names; None without one.

    Any text is allowed: the card may come from another person.
    """
    lines = text.partition("\n---")[0].splitlines()
    sums = [line.partition(":")[2].strip() for line in lines if line.strip().startswith("sha256:")]
    return sums[0] if len(sums) == 1 else None


def _header(shared: SharedFile) -> dict:
    of = shared.of
    header: dict = {"license": shared.license} if shared.license else {}
    header |= {"library_name": "drivezoo", "tags": TAGS, "pipeline_tag": "robotics"}
    tracks = of.tracks.values()
    header["metrics"] = [key for key in SHOWN if any(track.get(key) for track in tracks)]
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
        header["model-index"] = [{"name": _title(shared), "results": results}]
    trained_on = of.contents["drivezoo"]["data"].get("fingerprint")
    return header | {"drivezoo": {"file": shared.file, "sha256": shared.sha256, "data": trained_on}}


def _title(shared: SharedFile) -> str:
    return Path(shared.file).stem


def _file(shared: SharedFile) -> list[str]:
    """Return sentences on the file and on what it does not hold."""
    points = [
        f"File: {shared.file}, {len(shared.data):,} bytes, SHA-256 {shared.sha256}. It holds "
        "weights and settings, and no code.",
        own_latency(shared.of.checkpoint),
    ]
    points += [
        f"The network's code is not in the file: {part['name']} (SHA-256 begins with "
        f"{part['sha256']}), which its author has. Add it with parts=FILE."
        for part in shared.of.contents["drivezoo"].get("parts") or ()
    ]
    return points


def _drive(shared: SharedFile) -> list[Block]:
    repo, file = shared.repo, shared.file
    fetch = f'pip install "drivezoo[hub]"\ndrivezoo hub pull {repo}\n' if repo else ""
    file = f"outputs/hub/{repo}/{file}" if repo else file
    data = shared.of.checkpoint.data
    words = next_drive(file, data, ["drive", file, "sim=lake", "laps=1"])
    line = command_line(["drivezoo", *words])  # with the user's parts=, but not their folders
    return [Code(f"{fetch}{without_folders(line)}")]
