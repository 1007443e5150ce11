"""Read `status.json`, a run's status."""

from pathlib import Path

from zoo.base.bounded_files import read_json
from zoo.runs.record_fields import Fields, Number, Whole, check_fields, plain

NAME = "status.json"


class Status(Fields):
    """The contents of `status.json`, as `zoo.runs.status.write_status` writes it."""

    status: str | None = None
    reason: str | None = None
    pid: Whole | None = None
    host: str | None = None
    process_started: Number | None = None
    time: str | None = None
    finished_epochs: Whole | None = None


def read_status_file(folder: Path) -> dict:
    """Return a run's status as plain containers; an empty dict without a file.

    Raises:
        InputError: the file cannot be read.
    """
    path = folder / NAME
    if not path.exists():
        return {}
    return plain(check_fields(Status, read_json(path), path))
