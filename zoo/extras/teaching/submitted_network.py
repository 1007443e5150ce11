"""What a submission's network returns, and what its file tells of the training.

As a program it drives the benchmark, too, so that a submission is loaded in one process alone.
"""

import sys
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from zoo.base.child_process import limit_resource
from zoo.base.errors import InputError
from zoo.base.module_start import run_module
from zoo.base.plain_files import read_json
from zoo.base.rig import UDACITY
from zoo.base.whole_file import json_text, write_whole
from zoo.checkpoints.onnx_policy import TOLERANCE
from zoo.runs.record_fields import Count, Fields, Number, check_fields
from zoo.training.recorded_roads import trained_roads

IMAGES, SPEED_MPH = 64, 15.0
# On noise, trainings that differ only in their seed correlate below 0.6, and a network whose
# weights were changed by 3 % with its original by 0.998.
NEAR = 0.95
MOST_BYTES = 4_000_000_000  # memory of the process
FLAT, CLOSE = 1e-3, 0.02  # deviation of a steering that hardly changes; difference of two such


class NetworkFacts(Fields):
    """Facts on a network, to be compared with those of others.

    Attributes:
        outputs: steering, and throttle and spread if it has them, for each of `IMAGES` images.
        row_hashes: hashes of rows of its training, see `Recording.row_hashes`; None: unknown.
        roads: keys of the roads of its recordings, see `zoo.training.recorded_roads`.
    """

    outputs: list[Number]
    row_hashes: list[Count] | None = None
    roads: list[str] | None = None

    def equals(self, other: "NetworkFacts") -> bool:
        """Return whether the outputs are those of the same network, whatever runs it."""
        pairs = zip(self.outputs, other.outputs, strict=False)
        same = all(abs(first - second) <= TOLERANCE for first, second in pairs)
        return same and len(self.outputs) == len(other.outputs)

    def likeness(self, other: "NetworkFacts") -> str:
        """Return `the same`, `nearly the same` with slightly changed weights, or nothing."""
        if self.equals(other):
            return "the same"
        if any(len(facts.outputs) % IMAGES or not facts.outputs for facts in (self, other)):
            return ""  # of an earlier version
        ours, theirs = (np.reshape(facts.outputs, (IMAGES, -1))[:, 0] for facts in (self, other))
        near = np.abs(ours - theirs).max() <= CLOSE
        if min(ours.std(), theirs.std()) >= FLAT:
            near = np.corrcoef(ours, theirs)[0, 1] >= NEAR
        return "nearly the same" if near else ""


def facts_file(folder: Path) -> Path:
    """Return the file of the facts, beside the folder of the drives."""
    return folder.with_name(f"{folder.name}.json")


def read_facts(path: Path) -> NetworkFacts | None:
    """Return written facts; None if there are none."""
    return check_fields(NetworkFacts, read_json(path), path) if path.is_file() else None


def network_facts(file: Path) -> NetworkFacts:
    """Return the facts of a checkpoint or ONNX file.

    Raises:
        InputError: the file cannot be used, or its facts are of other types.
    """
    from zoo.checkpoints.checkpoint_policy import load_policy  # imports torch

    policy = load_policy(file).in_car(UDACITY)
    rng = np.random.default_rng(0)
    outputs = []
    for _ in range(IMAGES):
        blobs = rng.integers(0, 256, (8, 16, 3), np.uint8)  # of noise, all views are alike
        command = policy(cv2.resize(blobs, policy.view.frame[::-1]), SPEED_MPH)
        values = (command.steering, command.throttle, command.spread)
        outputs += [float(value) for value in values if value is not None]
    facts = {"row_hashes": policy.data.get("row_hashes"), "outputs": outputs}
    facts["roads"] = trained_roads(policy.config, policy.data)
    return check_fields(NetworkFacts, facts, file)


def write_facts(file: Path, out: Path) -> None:
    """Write the facts of a checkpoint or ONNX file as JSON; raise as `network_facts`."""
    write_whole(out, json_text(network_facts(file).model_dump()))


if __name__ == "__main__":
    limit_resource("RLIMIT_DATA", MOST_BYTES)  # a graph may ask for any amount at a later image
    facts = Path(sys.argv.pop(1))
    with suppress(InputError):  # of which the benchmark reports what is wrong with the file
        write_facts(Path(sys.argv[1]), facts)
    run_module("zoo.commands.benchmark", sys.argv[1:])
