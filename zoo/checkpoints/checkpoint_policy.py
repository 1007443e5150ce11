"""The policy of a checkpoint, and the loader of the policies of all files that drive.

A file of `drivezoo doubt` holds whole checkpoints that drive as one policy, as plain containers:
`drivezoo`, with `format` and `doubt` (`samples`, `seed`), and `members`, a list of checkpoints with
`drivezoo` and `state_dict`. One member drives with dropout, several as an ensemble.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from pydantic import Field

from zoo.base.bounded_files import check_version
from zoo.base.errors import InputError, placed_errors
from zoo.base.read_apart import read_apart
from zoo.checkpoints.checkpoint import (
    FORMAT,
    PREFIX,
    Checkpoint,
    build_checkpoint,
    checked_contents,
    checked_state,
    doubt_members,
    find_checkpoint,
    load_plain,
    read_checkpoint_file,
)
from zoo.checkpoints.doubt_policy import DropoutPolicy, EnsemblePolicy
from zoo.checkpoints.engine import Engine, chosen_forward
from zoo.checkpoints.frame_memory import FrameMemory, SessionPolicy
from zoo.checkpoints.frozen_graph import NetworkPolicy, network_inputs
from zoo.checkpoints.onnx_policy import OnnxPolicy, is_onnx, run_once
from zoo.checkpoints.policy_base import Command, output_command
from zoo.models.memory import Memory
from zoo.runs.record_fields import Fields, check_fields

MOST_SAMPLES, MOST_MEMBERS = 100, 100  # of a file of `drivezoo doubt`


class CheckpointPolicy(NetworkPolicy, SessionPolicy):
    """A policy with the view and the network of a checkpoint.

    >>> policy = load_policy("outputs/.../checkpoints/best.ckpt")  # doctest: +SKIP
    >>> policy(frame, 9.0)  # doctest: +SKIP
    Command(steering=-0.02, throttle=None, spread=None)

    Attributes:
        network: network in evaluation mode, on the CPU; must not be changed.
        forward: faster function with the outputs of `network`, or of its `step` if it has memory.
            `OnnxPolicy` lacks these two.
        view, config, data, name, parameters, takes_speed, outputs, predicts_spread: as in
            `OnnxPolicy`.
    """

    def __init__(self, checkpoint: Checkpoint, engine: Engine = "torch", threads: int = 1) -> None:
        super().__init__(checkpoint)
        self.forward, self.engine = chosen_forward(checkpoint, engine, threads)
        if isinstance(self.network, Memory):
            self.keep_memory(self.network.first_state(), self.network.window, self.data)

    def scored(self) -> "CheckpointPolicy":
        """Return a session that computes in double precision; see `double_forward`."""
        other = self.in_double(self.network)
        if isinstance(self.network, Memory) and not other.tied:
            state = self.network.first_state()
            first = [part.double() if part.is_floating_point() else part for part in state]
            other.memory = FrameMemory(first, self.window.stride)
        return other

    @torch.inference_mode()
    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the command for a frame.

        Args:
            frame: RGB image of the centre camera, uint8 [H, W, 3].
            speed_mph: the car's speed in mph.
        """
        inputs = network_inputs(self.view(frame), speed_mph if self.takes_speed else None)
        if self.memory is None:
            outputs = self.forward(*inputs)[0].tolist()
            return self.for_car(output_command(outputs, self.predicts_spread))
        steps = self.memory.step(self.forward, *inputs)[0].clamp(-1, 1).numpy()
        return Command(*self.in_time(steps, speed_mph).tolist())


def load_policy(
    path: str | Path, threads: int = 1, engine: Engine = "torch"
) -> CheckpointPolicy | OnnxPolicy | DropoutPolicy | EnsemblePolicy:
    """Return the policy of a checkpoint, or of a file of `drivezoo export` or `drivezoo doubt`.

    Args:
        path: file, run's folder, or `latest`; see `find_checkpoint`.
        threads: number of onnxruntime's threads; `torch.set_num_threads` sets torch's.
        engine: engine that runs a checkpoint's network, see `chosen_forward`; torch gives the same
            figures on each call.

    Raises:
        InputError: see `zoo.checkpoints.checkpoint.load_checkpoint`, `OnnxPolicy`, `build_doubt`,
            `DropoutPolicy` and `chosen_forward`.
    """
    if is_onnx(path):
        read_apart(run_once, Path(path))
        return OnnxPolicy(path, threads)
    path = find_checkpoint(path)
    contents = load_plain(path)
    if doubt_members(contents) is None:
        checkpoint = build_checkpoint(checked_contents(contents, path), path)
        return CheckpointPolicy(checkpoint, engine, threads)
    return doubt_policy(contents, path, threads, engine)


def doubt_policy(
    contents: dict, path: Path, threads: int = 1, engine: Engine = "torch"
) -> DropoutPolicy | EnsemblePolicy:
    """Return the policy of the contents of a file of `drivezoo doubt`.

    Raises:
        InputError: see `build_doubt` and `DropoutPolicy`.
    """
    members, settings = build_doubt(contents, path)
    if len(members) > 1:
        return EnsemblePolicy([CheckpointPolicy(one, engine, threads) for one in members])
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
