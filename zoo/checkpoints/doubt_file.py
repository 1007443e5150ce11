"""Files of `drivezoo doubt`: whole checkpoints that drive as one policy.

A file holds plain containers: `drivezoo`, with `format` and `doubt` (`samples`, `seed`), and
`members`, a list of checkpoints with `drivezoo` and `state_dict`. One member drives with dropout,
several as an ensemble.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field

from zoo.base.bounded_files import check_version
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import (
    FORMAT,
    PREFIX,
    Checkpoint,
    build_checkpoint,
    checked_contents,
    checked_state,
    doubt_members,
    read_checkpoint_file,
)
from zoo.runs.record_fields import Fields, check_fields

MOST_SAMPLES, MOST_MEMBERS = 100, 100


class DoubtSettings(Fields):
    """The settings of a file; an ensemble does not use them."""

    samples: Annotated[int, Field(ge=2, le=MOST_SAMPLES)]
    seed: Annotated[int, Field(ge=0, lt=2**63)]


def doubt_contents(paths: Sequence[Path], samples: int, seed: int) -> dict:
    """Return the contents of a file, from checkpoints.

    Raises:
        InputError: a file is not a checkpoint of a single network.
    """
    members = []
    for path in paths:
        contents = read_checkpoint_file(path)
        weights = {k: one for k, one in contents["state_dict"].items() if k.startswith(PREFIX)}
        members.append({"drivezoo": contents["drivezoo"], "state_dict": weights})
    card = {"format": FORMAT, "doubt": {"samples": samples, "seed": seed}}
    return {"drivezoo": card, "members": members}


def build_doubt(contents: dict, path: Path) -> tuple[list[Checkpoint], DoubtSettings]:
    """Return a file's checkpoints and settings.

    Args:
        contents: contents of the file, with `members`.
        path: file, for messages.

    Raises:
        InputError: a setting is wrong, or a member is not a checkpoint (see `build_checkpoint`).
    """
    found = contents["drivezoo"]
    check_version(found.get("format"), FORMAT, path)
    settings = check_fields(DoubtSettings, found["doubt"], f"{path}: drivezoo: doubt")
    members = doubt_members(contents) or []
    if not 1 <= len(members) <= MOST_MEMBERS:
        raise InputError(
            f"{path}: members: holds {len(members)} checkpoints, should hold 1 to {MOST_MEMBERS}; "
            "write it again with drivezoo doubt"
        )
    checkpoints = []
    seen: set[int] = set()
    for number, member in enumerate(members, 1):
        place = Path(f"{path}: member {number}")
        checked = checked_contents(member, place)
        weights = {one.data_ptr() for one in checked_state(checked["state_dict"], place).values()}
        if weights & seen:
            raise InputError(
                f"{place}: has the weights of a member before it; write the file again with "
                "drivezoo doubt, from checkpoints that differ"
            )
        seen |= weights
        checkpoints.append(build_checkpoint(checked, place))
    return checkpoints, settings
