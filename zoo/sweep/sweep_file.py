"""`sweep.json`: what a sweep was told."""

from pathlib import Path

from pydantic import Field

from zoo.runs.bounded_files import read_json
from zoo.runs.record_fields import Fields, Whole, check_fields


class Sweep(Fields):
    """What `zoo.sweep.sweep_record.write_record` wrote."""

    format: Whole
    arguments: list[str]
    jobs: list[list[str]] | None = None
    data: dict[str, str | None] = Field(default_factory=dict)
    versions: dict[str, str] = Field(default_factory=dict)
    started: str = ""
    search: bool = False


def read_sweep_file(path: Path) -> Sweep:
    """Return a sweep's record; raises InputError."""
    return check_fields(Sweep, read_json(path), path)
