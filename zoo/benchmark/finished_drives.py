"""The finished drives of a benchmark that is not complete, so that it can resume."""

import json
from collections.abc import Sequence
from pathlib import Path

from zoo.base.bounded_files import MOST_JSON_BYTES, parse_json, read_text
from zoo.base.errors import InputError
from zoo.base.whole_file import write_whole
from zoo.benchmark.drivers import Driver
from zoo.benchmark.result import DriveRecord
from zoo.benchmark.suite import Suite
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.record_fields import check_fields

NAME = "unfinished.jsonl"


class FinishedDrives:
    """A file of finished drives: a line that says what is driven, then a line for each drive.

    Args:
        folder: folder of the benchmark.
        drivers: drivers of the entry.
        suite: suite to drive.

    Attributes:
        drives: finished drives by the number of their job.

    Raises:
        InputError: the file belongs to other checkpoints, another suite or other code, or is
            damaged.
    """

    def __init__(self, folder: Path, drivers: Sequence[Driver], suite: Suite) -> None:
        self.path = folder / NAME
        self.drives: dict[int, DriveRecord] = {}
        first = {
            "suite": suite.name,
            "roads": suite.roads,
            "scenarios": [repr(one.scenario) for one in suite.drives],
            "mean_steering": suite.mean_steering,
            "drivers": [one.sha256 or one.file for one in drivers],
            "code": code_fingerprint()["hash"],
        }
        if self.path.is_file():
            self._read(first)
        else:
            self._write([json.dumps(first), ""])

    def _read(self, first: dict) -> None:
        lines = read_text(self.path, MOST_JSON_BYTES).split("\n")
        found = self._parse(lines[0], 1)
        if other := [key for key, value in first.items() if found.get(key) != value]:
            raise InputError(
                f"{self.path}: {other[0]}: differ from the drives that were begun; name another "
                "folder with out=, or delete this file"
            )
        # The text after the last line break is a drive that was written in part.
        for number, line in enumerate(lines[1:-1], start=2):
            row = self._parse(line, number)
            if type(row.get("job")) is not int:
                raise InputError(f"{self.path}: row {number}: job: is missing; {_DELETE}")
            record = check_fields(DriveRecord, row.get("drive"), self.path)
            self.drives[row["job"]] = record
        self._write([*lines[:-1], ""])

    def _parse(self, line: str, number: int) -> dict:
        try:
            found = parse_json(line)
        except ValueError:
            found = None
        if not isinstance(found, dict):
            raise InputError(f"{self.path}: row {number}: is damaged; {_DELETE}")
        return found

    def add(self, job: int, drive: DriveRecord) -> None:
        """Keep a finished drive."""
        self.drives[job] = drive
        self._write_line({"job": job, "drive": drive.model_dump()})

    def _write(self, lines: Sequence[str]) -> None:
        try:
            write_whole(self.path, "\n".join(lines))
        except OSError as error:
            raise InputError(f"{self.path}: {error.strerror}; its drives are kept") from None

    def _write_line(self, content: dict) -> None:
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(content) + "\n")

    def remove(self) -> None:
        """Delete the file, once the result is written."""
        self.path.unlink()


_DELETE = "delete this file and start again"
