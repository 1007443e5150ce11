"""What a class submits: a checkpoint or an ONNX file a student, and an optional card."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from datamodules.recording import Recording
from zoo.base.bounded_files import read_text
from zoo.base.errors import InputError, file_errors
from zoo.base.terminal import counted
from zoo.benchmark.result import Driver
from zoo.drives.intervals import wilson_interval
from zoo.grade.submitted_network import NetworkFacts

ENDINGS = (".ckpt", ".onnx")
MOST_CARD_BYTES = 1_000_000
# How a card of drivezoo states them, see `zoo.report.model_card`.
STATED = {
    "parameters": re.compile(r"([\d,]+) parameters"),
    "data": re.compile(r"with fingerprint (\w+)"),
}


@dataclass(frozen=True)
class Submission:
    """A student's file.

    Attributes:
        name: name of the student: that of the folder, or of the file without its ending.
        file: checkpoint or ONNX file; None where there is none, or several.
        problem: why nothing can be driven; empty if something can.
    """

    name: str
    file: Path | None
    problem: str = ""

    @property
    def cards(self) -> list[Path]:
        """Return the Markdown files that belong to the file."""
        assert self.file is not None
        own = [self.file.with_suffix(".md"), self.file.parent / f"{self.name}.md"]
        if self.file.parent.name == self.name:
            own = sorted(self.file.parent.glob("*.md"))
        return [one for one in dict.fromkeys(own) if one.is_file()]


def find_submissions(folder: Path) -> list[Submission]:
    """Return the submissions of a folder, sorted by name.

    Raises:
        InputError: the folder cannot be read, has no submission, or two of the same name.
    """
    with file_errors(folder, "cannot be read ({}); name the folder of the submissions"):
        entries = sorted(one for one in folder.iterdir() if not one.name.startswith("."))
    found = [_of_folder(one) for one in entries if one.is_dir()]
    found += [Submission(one.stem, one) for one in entries if one.suffix in ENDINGS]
    names = [one.name for one in found]
    if not found:
        raise InputError(f"{folder}: holds no {' or '.join(ENDINGS)} file, and no folder of one")
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"{folder}: {twice[0]} stands for two submissions; rename one")
    return sorted(found, key=lambda one: one.name)


def _of_folder(folder: Path) -> Submission:
    files = sorted(one for one in folder.rglob("*") if one.suffix in ENDINGS and one.is_file())
    if len(files) == 1:
        return Submission(folder.name, files[0])
    count = f"{counted(len(files), 'network')}, must be one" if files else "no .ckpt or .onnx file"
    return Submission(folder.name, None, f"{folder}: has {count}")


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
    found = []
    recorded = (facts and facts.roads) or []
    if known := sorted(track for key, track in roads.items() if key in recorded):
        found.append(f"trained on {', '.join(known)}, which the marks are driven on")
    if recording is not None and driver.data != (course := recording.fingerprint()):
        trained = driver.data or "an unknown recording"
        share = _shared_rows((facts and facts.row_hashes) or [], set(recording.row_hashes()))
        found.append(f"trained on {trained}, not on the course's recording ({course}): {share}")
    for card in submission.cards:
        text = read_text(card, MOST_CARD_BYTES)
        for key, form in STATED.items():
            stated, own = form.search(text), str(getattr(driver, key))
            if stated and own and stated[1].replace(",", "") != own:
                found.append(f"{card.name} states {stated[0]}, the file has {own}")
    return found


def _shared_rows(sample: Sequence[int], course: set[int]) -> str:
    """Return which share of a training's rows is of the course, with its 95 % interval."""
    if not sample:
        return "how many of its rows are of the course is unknown"
    shared = sum(one in course for one in sample)
    low, high = wilson_interval(shared, len(sample))
    share = 100 * shared / len(sample)
    return f"{share:.0f} % ({100 * low:.0f} to {100 * high:.0f}) of its rows are of the course"
