"""What a class submits: a checkpoint or an ONNX file a student, and an optional card."""

import hashlib
import importlib.util
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from datamodules.recording import Recording
from zoo.base.bounded_files import read_text
from zoo.base.errors import InputError, UsageError, file_errors
from zoo.base.terminal import counted
from zoo.checkpoints.onnx_policy import INSTALL, is_onnx
from zoo.driving.intervals import share_interval
from zoo.extras.teaching.submitted_network import NetworkFacts
from zoo.results.result import Driver

ENDINGS = (".ckpt", ".onnx")
NOTES = (".csv", ".db", ".html", ".ini", ".md", ".pdf", ".txt", ".xlsx", ".yaml")  # no submissions
MOST_CARD_BYTES = 1_000_000
# How a card of drivezoo states them, see `zoo.scoring.model_card`.
STATED = {
    "parameters": re.compile(r"([\d,]+) parameters"),
    "data": re.compile(r"with fingerprint (\w+)"),
}


@dataclass(frozen=True)
class Submission:
    """A student's file.

    Attributes:
        name: name of the student: that of the folder, or of the file without its ending.
        file: checkpoint or ONNX file, or one of another kind, which is a problem; None where there
            is none, or several.
        problem: why nothing can be driven; empty if something can.
    """

    name: str
    file: Path | None
    problem: str = ""

    @property
    def stem(self) -> str:
        """Return the beginning of its files' names: its name, or a part that a file can have."""
        plain = re.sub(r"[^\w .,'()-]", "_", self.name).encode()[:80].decode(errors="ignore")
        if plain == self.name:
            return plain
        return f"{plain}-{hashlib.sha256(os.fsencode(self.name)).hexdigest()[:8]}"

    @property
    def number(self) -> str:
        """Return the student's number that the name begins with, as in `0123_anna`, or nothing."""
        match = re.match(r"[0-9]+(?![^\W_])", self.name)
        return match[0] if match else ""

    @property
    def submitted(self) -> str:
        """Return the time of the file's last change, local time."""
        try:
            seconds = self.file.stat().st_mtime if self.file else None
        except OSError:  # it was removed since
            seconds = None
        return "-" if seconds is None else f"{datetime.fromtimestamp(seconds):%Y-%m-%d %H:%M}"

    @property
    def cards(self) -> list[Path]:
        """Return the Markdown files that belong to the file."""
        assert self.file is not None
        cards = [self.file.with_suffix(".md"), self.file.parent / f"{self.name}.md"]
        if self.file.parent.name == self.name:
            cards = sorted(self.file.parent.glob("*.md"))
        return [card for card in dict.fromkeys(cards) if card.is_file()]


def find_submissions(folder: Path, out: Path | None = None) -> list[Submission]:
    """Return the submissions of a folder, sorted by name.

    What is wrong with one of them is its `problem`, and does not end the others' marks. A file of
    another kind, such as a .h5 or .zip, is a submission with a problem, so that no student is left
    out. Hidden files, a Mac's `__MACOSX`, `NOTES`, and what has the name of a network or folder
    are no submissions.

    Args:
        folder: folder of the submissions.
        out: output folder, which is no submission; None: it is elsewhere.

    Raises:
        InputError: the folder cannot be read, or has no submission.
        UsageError: onnxruntime, which runs a submission, is not installed.
    """
    by_name: dict[str, list[Path]] = {}
    with file_errors(folder, "cannot be read ({}); name the folder of the submissions"):
        for entry in sorted(folder.iterdir()):
            is_note = entry.is_file() and entry.suffix.lower() in NOTES
            # Not `Path.resolve`, which raises for a link to itself.
            is_out = out is not None and os.path.realpath(entry) == os.path.realpath(out)
            if not entry.name.startswith((".", "__MACOSX")) and not is_note and not is_out:
                by_name.setdefault(entry.name if entry.is_dir() else entry.stem, []).append(entry)
    if not by_name:
        raise InputError(f"{folder}: holds no {' or '.join(ENDINGS)} file, and no folder of one")
    submissions = [_submission(name, paths) for name, paths in sorted(by_name.items())]
    files = [entry.file for entry in submissions if entry.file and is_onnx(entry.file)]
    if files and importlib.util.find_spec("onnxruntime") is None:
        raise UsageError(f"{files[0]}: onnxruntime, which runs it, is not installed; {INSTALL}")
    return submissions


def _submission(name: str, paths: Sequence[Path]) -> Submission:
    """Return the one submission of a name, or what is wrong with it."""
    paths = [path for path in paths if _is_network(path) or not path.is_file()] or paths[:1]
    first = paths[0]
    if len(paths) > 1:
        names = " and ".join(path.name for path in paths)
        return Submission(name, None, f"{name} stands for two submissions, {names}; keep one")
    try:
        # A link may lead to another student's, to the teacher's own, or to the whole disk.
        inner = sorted(first.rglob("*")) if first.is_dir() and not first.is_symlink() else paths
        files = [path for path in inner if _is_network(path) and path.is_file()]
    except OSError as error:
        return Submission(name, None, f"{first}: cannot be read ({error.strerror})")
    if len(files) == 1:
        return Submission(name, files[0])
    problem = f"has {counted(len(files), 'network')}, must be one"
    if not files:
        problem = "is or has no .ckpt or .onnx file that is no link; hand in one"
    return Submission(name, first if first.is_file() else None, f"{first}: {problem}")


def _is_network(path: Path) -> bool:
    return path.suffix.lower() in ENDINGS and path.name[0] != "." and not path.is_symlink()


def warnings_of(
    submission: Submission,
    driver: Driver,
    facts: NetworkFacts | None,
    roads: Mapping[str, str],
    recording: Recording | None,
) -> list[str]:
    """Return what a teacher should look at; nothing of it changes a mark.

    Args:
        submission: a student's file.
        driver: what the file says of itself.
        facts: facts on its network; None where they are unknown.
        roads: roads of the marks, by their keys, see `zoo.training.recorded_roads`.
        recording: recording of the course; None for any.
    """
    warnings = []
    recorded = (facts and facts.roads) or []
    if driven := sorted(track for key, track in roads.items() if key in recorded):
        warnings.append(f"trained on {', '.join(driven)}, which the marks are driven on")
    hashes, data = (facts and facts.row_hashes) or [], driver.data
    if recording and (data or hashes) and data != (course := recording.fingerprint()):
        trained = data or "an unknown recording"
        share = _shared_rows(hashes, set(recording.row_hashes()))
        warnings.append(f"trained on {trained}, not on the course's recording ({course}): {share}")
    if facts is None or (facts.roads is None and facts.row_hashes is None):
        warnings.append("its file tells nothing of its training, neither roads nor rows")
    for card in submission.cards:
        try:
            text = read_text(card, MOST_CARD_BYTES)
        except InputError as error:
            warnings.append(str(error))
            continue
        for key, form in STATED.items():
            stated, value = form.search(text), str(getattr(driver, key))
            if stated and value and stated[1].replace(",", "") != value:
                warnings.append(f"{card.name} states {stated[0]}, the file has {value}")
    return warnings


def _shared_rows(sample: Sequence[int], course: set[int]) -> str:
    """Return which share of a training's rows is of the course, with its 95 % interval."""
    if not sample:
        return "how many of its rows are of the course is unknown"
    shared = sum(row in course for row in sample)
    low, high = share_interval(shared, len(sample))
    share = 100 * shared / len(sample)
    return f"{share:.0f} % ({100 * low:.0f} to {100 * high:.0f}) of its rows are of the course"
