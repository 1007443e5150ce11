"""The schema of `sweep.json`, the record of a sweep."""

from pathlib import Path

from pydantic import Field

from zoo.base.bounded_files import read_json
from zoo.runs.record_fields import Fields, Whole, check_fields


class Sweep(Fields):
    """The fields that `zoo.sweep.sweep_record.write_record` writes."""

    format: Whole
    arguments: list[str]
    jobs: list[list[str]] | None = None
    data: dict[str, str | None] = Field(default_factory=dict)
    versions: dict[str, str] = Field(default_factory=dict)
    started: str = ""
    search: bool = False


def read_sweep_file(path: Path) -> Sweep:
    """Return a sweep's record; raises InputError for a damaged one."""
    return check_fields(Sweep, read_json(path), path)
