"""The file of `drivezoo doubt`: whole checkpoints that drive as one policy.

It is plain containers: `drivezoo`, with `format` and `doubt` (`samples`, `seed`), and `members`, a
list of checkpoints with `drivezoo` and `state_dict`. One member drives with dropout, several as an
ensemble.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from zoo.base.errors import InputError, placed_errors
from zoo.base.plain_files import check_version
from zoo.checkpoints.checkpoint import (
    FORMAT,
    PREFIX,
    Checkpoint,
    build_checkpoint,
    checked_contents,
    checked_state,
    has_card,
    read_checkpoint_file,
)
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.engine import Engine
from zoo.extras.research.doubt_policy import DropoutPolicy, EnsemblePolicy
from zoo.runs.record_fields import Fields, check_fields

MOST_SAMPLES, MOST_MEMBERS = 100, 100
title = "file of drivezoo doubt"


def detect(contents: Any) -> bool:
    """Return whether a file's contents are of `drivezoo doubt`."""
    has_members = has_card(contents) and isinstance(contents.get("members"), list)
    return has_members and "doubt" in contents["drivezoo"]


def read(
    contents: dict, path: Path, threads: int = 1, engine: Engine = "torch"
) -> DropoutPolicy | EnsemblePolicy:
    """Return the policy of a file's contents; see `zoo.checkpoints.policy_kinds.PolicyKind`.

    Raises:
        InputError: see `build_doubt` and `DropoutPolicy`.
    """
    members, settings = build_doubt(contents, path)
    if len(members) > 1:
        return EnsemblePolicy([CheckpointPolicy(member, engine, threads) for member in members])
    with placed_errors(path):
        return DropoutPolicy(members[0], settings.samples, settings.seed, engine, threads)


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
        state = contents["state_dict"]
        weights = {name: state[name] for name in state if name.startswith(PREFIX)}
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
    card, members = contents["drivezoo"], contents["members"]
    check_version(card.get("format"), FORMAT, path)
    settings = check_fields(DoubtSettings, card["doubt"], f"{path}: drivezoo: doubt")
    if not 1 <= len(members) <= MOST_MEMBERS:
        raise InputError(
            f"{path}: members: holds {len(members)} checkpoints, should hold 1 to {MOST_MEMBERS}; "
            "write it again with drivezoo doubt"
        )
    checkpoints = []
    seen: set[int] = set()
    for number, member in enumerate(members, 1):
        label = Path(f"{path}: member {number}")
        checked = checked_contents(member, label)
        weights = {
            tensor.data_ptr() for tensor in checked_state(checked["state_dict"], label).values()
        }
        if weights & seen:
            raise InputError(
                f"{label}: has the weights of a member before it; write the file again with "
                "drivezoo doubt, from checkpoints that differ"
            )
        seen |= weights
        checkpoints.append(build_checkpoint(checked, label))
    return checkpoints, settings
